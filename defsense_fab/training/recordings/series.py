"""Signals of a read-out board in files of other systems, and tables of numbers in CSV files."""

from __future__ import annotations

import sys
from bisect import bisect_left
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import TrainingError

#: The one column of text.
RUN = "run"
#: Suffix of the names of resistances.
OHM = "_ohm"

_BLOCK_LINES = 10_000  # lines that are split at once
# Columns that are not channels, in addition to `run`.
_OTHER_COLUMNS = (
    "frame",
    "time",
    "alignment_residual",
    "counter",
    "device_us",
    "host_ns",
    "led",
    "late",
)
_MAX_SAMPLE_STEP_S = 1.0  # beyond which times are hardly in seconds
_MAX_CHANGE = 10.0  # no cord's resistance grows to more than eleven times R0


@dataclass(frozen=True)
class Table:
    """A table of numbers.

    Attributes:
        path: File of the table.
        names: Names of the k columns.
        values: Numbers, shape (n, k); NaN for empty cells.
        run: Text of the column `run`, of each of the n rows; empty without such a column.
    """

    path: Path
    names: tuple[str, ...]
    values: Float
    run: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Float:
        """Return a column (n,); raise TrainingError if there is none of this name."""
        if name not in self.names:
            raise TrainingError(
                f"has no column {name}; its columns are {', '.join(self.names)}",
                code="column-missing",
                where=self.path,
                action="Check whether this is the right file",
                column=name,
            )
        return np.asarray(self.values[:, self.names.index(name)])

    def columns(self, names: tuple[str, ...] | list[str]) -> Float:
        """Return some columns (n, c)."""
        if not names:
            return np.empty((len(self.values), 0))
        return np.column_stack([self[name] for name in names])


def read_table(path: Path) -> Table:
    """Read a CSV file whose first line names the columns.

    Args:
        path: The file.

    Returns:
        The table.

    Raises:
        TrainingError: If the file cannot be read or is not such a table; the line is stated.
    """
    lines = _read_lines(path)
    header = [cell.strip().strip('"') for cell in lines[0].split(",")] if lines else []
    if len(header) < 2 or any(_is_number(cell) for cell in header):
        raise TrainingError(
            "the first line does not name the columns, separated by commas",
            code="header-missing",
            where=f"{path}:1",
            action="Name the columns in the first line",
        )
    duplicates = [name for k, name in enumerate(header) if name in header[:k]]
    if duplicates:
        raise TrainingError(
            f"has two columns {duplicates[0]!r}",
            code="column-repeated",
            where=f"{path}:1",
            action="Rename one",
            column=duplicates[0],
        )
    kept = [k for k, name in enumerate(header) if name != RUN]
    names, run = tuple(header[k] for k in kept), list[str]()
    parts = [np.empty((0, len(kept)))]
    for start in range(1, len(lines), _BLOCK_LINES):
        block = enumerate(lines[start : start + _BLOCK_LINES], start + 1)
        rows = [(k, line.split(",")) for k, line in block if line.strip()]
        for k, row in rows:
            if len(row) != len(header):
                raise TrainingError(
                    f"has {len(row)} cells for {len(header)} columns, and may be truncated",
                    code="cell-count-differs",
                    where=f"{path}:{k}",
                    action="Delete the line, or copy the file again",
                    line=k,
                )
        if RUN in header:
            run += [sys.intern(row[header.index(RUN)].strip()) for _, row in rows]
        parts.append(_parse_rows(path, rows, kept, names))
    return Table(path, names, np.concatenate(parts), tuple(run))


def _read_lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise TrainingError(
            f"cannot be read: {error.strerror}",
            code="file-unreadable",
            where=path,
            action="Check the path",
        ) from None
    except UnicodeDecodeError:
        raise TrainingError(
            "is not a table in text (CSV)",
            code="not-a-table",
            where=path,
            action="Export it as CSV",
        ) from None


def _parse_rows(
    path: Path, rows: list[tuple[int, list[str]]], kept: list[int], names: tuple[str, ...]
) -> Float:
    """Return the numbers (n, k) of the kept columns."""
    values = np.empty((len(rows), len(kept)))
    for k, column in enumerate(kept):
        cells = [row[column].strip() or "nan" for _, row in rows]
        try:
            values[:, k] = np.fromiter(map(float, cells), float, len(cells))
        except ValueError:
            bad = next(i for i, cell in enumerate(cells) if not _is_number(cell))
            raise TrainingError(
                f"{names[k]} is not a number: {cells[bad][:40]!r}",
                code="not-a-number",
                where=f"{path}:{rows[bad][0]}",
                column=names[k],
                line=rows[bad][0],
            ) from None
    return values


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class Series:
    """Samples of a read-out board.

    Attributes:
        source: Name of the file or stream.
        channels: Names of the c channels.
        time: Times of the n samples, shape (n,), s, on any clock.
        ohm: Resistances, shape (n, c), ohm; NaN where unknown. None if not given.
        change: Signals (R - R0)/R0, shape (n, c); NaN where unknown. None if not given.

    Raises:
        TrainingError: If no number is known, times are not in seconds, or signals are too large.
    """

    source: str
    channels: tuple[str, ...]
    time: Float
    ohm: Float | None
    change: Float | None

    def __post_init__(self) -> None:
        values = self.ohm if self.ohm is not None else self.change
        if not self.channels or values is None or not np.isfinite(values).any():
            raise TrainingError(
                "has no channel with a number in it", code="no-samples", where=self.source
            )
        if len(self.time) < 2 or not np.median(np.diff(self.time)) < _MAX_SAMPLE_STEP_S:
            step = np.median(np.diff(self.time)) if len(self.time) > 1 else np.inf
            raise TrainingError(
                f"its {len(self.time)} samples are {step:g} s apart",
                code="wrong-unit",
                where=self.source,
                action="Give times in seconds",
                quantity="times",
                step=float(step),
            )
        usual = np.nanmedian(np.abs(values[np.isfinite(values).any(axis=1)]))
        if self.ohm is None and usual > _MAX_CHANGE:
            raise TrainingError(
                f"signals of {usual:.4g} cannot be (R - R0)/R0",
                code="signals-too-large",
                where=self.source,
                action=f"Name resistances {self.channels[0]}{OHM}, or give their unit",
                value=float(usual),
            )

    def rest(self, is_at_rest: Bool) -> tuple[Float, str]:
        """Determine the resistances at rest.

        Args:
            is_at_rest: In which samples the device is at rest, shape (n,).

        Returns:
            R0, shape (c,), ohm (1 if no resistance is known), and a note on its origin.

        Raises:
            TrainingError: If a channel has no resistance at rest.
        """
        c = len(self.channels)
        if self.ohm is None:
            return np.ones(c), "unknown: resistances are in units of R0"
        with np.errstate(all="ignore"):
            if self.change is not None:
                each, origin = self.ohm / (1 + self.change), "that of the file's own signals"
            else:
                each, origin = np.where(is_at_rest[:, None], self.ohm, np.nan), "the median at rest"
        columns = [column[np.isfinite(column)] for column in each.T]
        empty = [n for n, column in zip(self.channels, columns, strict=True) if not len(column)]
        if empty:
            raise TrainingError(
                f"{empty[0]} has no resistance while the device is at rest",
                code="no-rest-pose",
                where=self.source,
                action="Record a rest at the start",
                channel=empty[0],
            )
        return np.array([float(np.median(column)) for column in columns]), origin


def read_series(path: Path) -> Series:
    """Read signals from a CSV file.

    The file has a column `time`, in s, and one for each channel: (R - R0)/R0 under its name, or
    resistances in ohm under `<name>_ohm`, or both.

    Args:
        path: The file.

    Returns:
        The signals.

    Raises:
        TrainingError: If the file cannot be read, or is not such a table.
    """
    table = read_table(path)
    if len(set(table.run)) > 1:
        raise TrainingError(
            f"has samples of {len(set(table.run))} runs",
            code="several-runs",
            where=path,
            action="Give the session's folder",
            count=len(set(table.run)),
        )
    names = [n for n in table.names if n not in _OTHER_COLUMNS and n != RUN]
    return make_series(str(path), names, table["time"], table.columns(names))


def make_series(source: str, names: list[str], time: Float, values: Float) -> Series:
    """Make a series of named columns.

    Args:
        source: Name of the file or stream.
        names: Names of the k columns; those of resistances end in `_ohm`.
        time: Times, shape (n,), s.
        values: Numbers, shape (n, k).

    Returns:
        The series, without rows that have no number.

    Raises:
        TrainingError: If only some channels have resistances.
    """
    with_ohm = [n.removesuffix(OHM) for n in names if n.endswith(OHM) and n != OHM]
    with_change = [n for n in names if not n.endswith(OHM) or n == OHM]
    if with_ohm and with_change and set(with_ohm) != set(with_change):
        odd = sorted(set(with_ohm) ^ set(with_change))[0]
        raise TrainingError(
            f"{odd} has only signals or only resistances, and other channels differ",
            code="quantities-differ",
            where=source,
            action="Give the same quantities for all channels",
            channel=odd,
        )
    channels = tuple(with_change or with_ohm)

    def columns(suffix: str) -> Float:
        return values[:, [names.index(n + suffix) for n in channels]]

    # A row without any number is not a sample; dropped frames give such rows.
    is_sample = np.isfinite(time) & ~np.isnan(values).all(axis=1)
    return Series(
        source,
        channels,
        time[is_sample],
        columns(OHM)[is_sample] if with_ohm else None,
        columns("")[is_sample] if with_change else None,
    )


def increasing_times(time: Float) -> Bool:
    """Return which of the times (n,) are known and increase, keeping as many as possible.

    After the read-out board restarted, its clock is known to some ms only, and samples may seem to
    come twice.
    """
    is_known = np.isfinite(time)
    if (np.diff(time[is_known]) > 0).all():
        return np.asarray(is_known)
    # The longest increasing subsequence (Fredman 1975, On computing the length of longest
    # increasing subsequences): for each length, the smallest last time and its row.
    ends, rows, previous = list[float](), list[int](), np.full(len(time), -1)
    for k in np.flatnonzero(is_known).tolist():
        at = bisect_left(ends, time[k])
        previous[k] = rows[at - 1] if at else -1
        ends[at : at + 1], rows[at : at + 1] = [float(time[k])], [k]
    is_kept = np.zeros(len(time), bool)
    k = rows[-1]
    while k >= 0:
        is_kept[k] = True
        k = int(previous[k])
    return is_kept
