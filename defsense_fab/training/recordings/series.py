"""Signals of a read-out board in files of others, on the way to a recording."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import TrainingError

# Tables of numbers in CSV files, by the names of their columns.

#: The one column of text.
RUN = "run"
_BLOCK = 10_000  # lines that are taken apart at once


@dataclass(frozen=True)
class Table:
    """Columns by their `names` (k), `values` (n, k), NaN for empty cells; of `run`, where there is
    such a column, the text of each row (n), else none."""

    path: Path
    names: tuple[str, ...]
    values: Float
    run: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Float:
        """A column (n,). Raises TrainingError where there is none."""
        if name not in self.names:
            raise TrainingError(
                f"{self.path}: has no column {name}; its columns are {', '.join(self.names)}; is"
                " it another file?"
            )
        return np.asarray(self.values[:, self.names.index(name)])

    def columns(self, names: tuple[str, ...] | list[str]) -> Float:
        """Some columns (n, c)."""
        if not names:
            return np.empty((len(self.values), 0))
        return np.column_stack([self[name] for name in names])


def read_table(path: Path) -> Table:
    """From CSV with a line of names. Raises TrainingError with the line for what is not."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise TrainingError(f"{path}: cannot be read: {error.strerror}; check the path") from None
    except UnicodeDecodeError:
        raise TrainingError(f"{path}: is no table in text (CSV); export it as such") from None
    lines = text.splitlines()
    head = [cell.strip().strip('"') for cell in lines[0].split(",")] if lines else []
    if len(head) < 2 or any(_number(cell) for cell in head):
        raise TrainingError(
            f"{path}:1: the first line must name the columns, with commas between them"
        )
    twice = [name for k, name in enumerate(head) if name in head[:k]]
    if twice:
        raise TrainingError(f"{path}:1: has two columns {twice[0]!r}; rename one")
    kept = [k for k, name in enumerate(head) if name != RUN]
    names, run = tuple(head[k] for k in kept), list[str]()
    parts = [np.empty((0, len(kept)))]
    for begin in range(1, len(lines), _BLOCK):
        block = enumerate(lines[begin : begin + _BLOCK], begin + 1)
        rows = [(k, line.split(",")) for k, line in block if line.strip()]
        for k, row in rows:
            if len(row) != len(head):
                raise TrainingError(
                    f"{path}:{k}: {len(row)} cells under {len(head)} columns; is it cut off? Delete"
                    " the line, or copy the file again"
                )
        if RUN in head:
            run += [sys.intern(row[head.index(RUN)].strip()) for _, row in rows]
        parts.append(_values(path, rows, kept, names))
    return Table(path, names, np.concatenate(parts), tuple(run))


def _values(
    path: Path, rows: list[tuple[int, list[str]]], kept: list[int], names: tuple[str, ...]
) -> Float:
    out = np.empty((len(rows), len(kept)))
    for k, column in enumerate(kept):
        cells = [row[column].strip() or "nan" for _, row in rows]
        try:
            out[:, k] = np.fromiter(map(float, cells), float, len(cells))
        except ValueError:
            bad = next(i for i, cell in enumerate(cells) if not _number(cell))
            raise TrainingError(
                f"{path}:{rows[bad][0]}: {names[k]} is not a number: {cells[bad][:40]!r}"
            ) from None
    return out


def _number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


#: Ends of the names of resistances.
OHM = "_ohm"
#: Columns that are no channels, beside `run`.
_OTHERS = ("frame", "time", "alignment_residual", "counter", "device_us", "host_ns", "led", "late")
_SLOWEST = 1.0  # s between samples, beyond which times are hardly seconds
_MOST = 10.0  # no cord's resistance grows to more than eleven times R0


@dataclass(frozen=True)
class Series:
    """n samples of c `channels` of the file `source` at `time` (n,) s, of any clock: resistances
    `ohm` (n, c), or (R - R0)/R0 as `change` (n, c), or both; NaN where not known."""

    source: str
    channels: tuple[str, ...]
    time: Float
    ohm: Float | None
    change: Float | None

    def __post_init__(self) -> None:
        values = self.ohm if self.ohm is not None else self.change
        if not self.channels or values is None or not np.isfinite(values).any():
            raise TrainingError(f"{self.source}: there is no channel with a number in it")
        if len(self.time) < 2 or not np.median(np.diff(self.time)) < _SLOWEST:
            apart = np.median(np.diff(self.time)) if len(self.time) > 1 else np.inf
            raise TrainingError(
                f"{self.source}: {len(self.time)} samples that are {apart:g} apart; times must be"
                " in seconds"
            )
        usual = np.nanmedian(np.abs(values[np.isfinite(values).any(axis=1)]))
        if self.ohm is None and usual > _MOST:
            raise TrainingError(
                f"{self.source}: signals of {usual:.4g} cannot be (R - R0)/R0; name resistances"
                f" {self.channels[0]}{OHM}, or give their unit"
            )

    def rest(self, at_rest: Bool) -> tuple[Float, str]:
        """R0 (c,) ohm, of samples of which some are `at_rest` (n,), and where it is from; 1 where
        no resistance is known."""
        c = len(self.channels)
        if self.ohm is None:
            return np.ones(c), "not known: resistances are told in units of R0"
        with np.errstate(all="ignore"):
            if self.change is not None:
                each, why = self.ohm / (1 + self.change), "that of the file's own signals"
            else:
                each, why = np.where(at_rest[:, None], self.ohm, np.nan), "the median at rest"
        columns = [column[np.isfinite(column)] for column in each.T]
        none = [n for n, column in zip(self.channels, columns, strict=True) if not len(column)]
        if none:
            raise TrainingError(
                f"{self.source}: {none[0]} has no resistance while the device is at rest; record a"
                " rest at the beginning"
            )
        return np.array([float(np.median(column)) for column in columns]), why


def read_series(path: Path) -> Series:
    """From CSV with a column `time`, s, and one for each channel: (R - R0)/R0 by its name, or
    resistances in ohm as `<name>_ohm`, or both. Raises TrainingError."""
    table = read_table(path)
    if len(set(table.run)) > 1:
        raise TrainingError(
            f"{path}: has samples of {len(set(table.run))} runs; give the session's folder"
        )
    names = [n for n in table.names if n not in _OTHERS and n != RUN]
    return series_of(str(path), names, table["time"], table.columns(names))


def series_of(source: str, names: list[str], time: Float, values: Float) -> Series:
    """Of columns (n, k) with `names`, resistances by theirs. Raises TrainingError where some
    channels have resistances and others have not."""
    ohm = [n.removesuffix(OHM) for n in names if n.endswith(OHM) and n != OHM]
    change = [n for n in names if not n.endswith(OHM) or n == OHM]
    if ohm and change and set(ohm) != set(change):
        odd = sorted(set(ohm) ^ set(change))[0]
        raise TrainingError(
            f"{source}: {odd} has either signals or resistances, and other channels differ; give"
            " the same of all"
        )
    channels = tuple(change or ohm)

    def pick(end: str) -> Float:
        return values[:, [names.index(n + end) for n in channels]]

    # A row without any number is no sample, such as those of frames that were dropped.
    known = np.isfinite(time) & ~np.isnan(values).all(axis=1)
    return Series(
        source, channels, time[known], pick(OHM)[known] if ohm else None,
        pick("")[known] if change else None,
    )  # fmt: skip
