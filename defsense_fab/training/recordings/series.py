"""Signals of a read-out board in files of other systems, and tables of numbers in text."""

from __future__ import annotations

import sys
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import TrainingError
from ...core.storage.delimited_text import (
    MAX_ROWS_BEFORE_CUT,
    Row,
    cut_note,
    is_cut_off,
    read_delimited,
)

#: The one column of text.
RUN = "run"
#: Suffix of the names of resistances.
OHM = "_ohm"

#: Columns that are not channels, in addition to `run`.
OTHER_COLUMNS = (
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
        notes: What was left out, with the file's name.
    """

    path: Path
    names: tuple[str, ...]
    values: Float
    run: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

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
    """Read a table in text whose first line names the columns.

    A last row that is cut off is left out, with a note.

    Args:
        path: The file; see `core.storage.delimited_text` for its forms.

    Returns:
        The table.

    Raises:
        TrainingError: If the file cannot be read or is not such a table; the line is stated.
    """
    table = read_delimited(path, TrainingError)
    if len(table.names) < 2 or any(map(_is_number, table.names)):
        raise TrainingError(
            "the first line does not name the columns",
            code="header-missing",
            where=table.place(table.header_line),
            action="Name the columns in the first line, with separators between them",
        )
    table.rename([_column_name(name) for name in table.names])
    kept = [k for k, name in enumerate(table.names) if name not in (RUN, "")]
    names, run = tuple(table.names[k] for k in kept), list[str]()
    parts, notes, previous = [np.empty((0, len(kept)))], tuple[str, ...](), list[list[str]]()
    for block, is_last in _with_last(table.blocks()):
        if is_last and not table.ends_with_newline:
            earlier = [*previous, *(row.cells for row in block[:-1])][-MAX_ROWS_BEFORE_CUT:]
            if is_cut_off(block[-1].cells, earlier, len(table.names)):
                notes = (cut_note(path, block.pop().line),)
        for row in block:
            if len(row.cells) != len(table.names):
                raise TrainingError(
                    f"has {len(row.cells)} cells for {len(table.names)} columns",
                    code="cell-count-differs",
                    where=table.place(row.line),
                    action="Delete the line, or copy the file again",
                    line=row.line,
                )
        if RUN in table.names:
            column = table.names.index(RUN)
            run += [sys.intern(row.cells[column]) for row in block]
        lines = [row.line for row in block]
        values = np.empty((len(block), len(kept)))
        for k, column in enumerate(kept):
            values[:, k] = table.numbers([row.cells[column] for row in block], lines, names[k])
        parts.append(values)
        previous = [row.cells for row in block[-MAX_ROWS_BEFORE_CUT:]]
    return Table(path, names, np.concatenate(parts), tuple(run), notes)


def _with_last(blocks: Iterator[list[Row]]) -> Iterator[tuple[list[Row], bool]]:
    """Iterate over blocks and whether each is the last."""
    block = next(blocks, None)
    while block is not None:
        following = next(blocks, None)
        yield block, following is None
        block = following


def _column_name(name: str) -> str:
    """Return the name of a column with the package's own names in small letters."""
    if name.lower() in (*OTHER_COLUMNS, RUN):
        return name.lower()
    return name[: -len(OHM)] + OHM if name.lower().endswith(OHM) else name


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
        notes: What was left out of the file.

    Raises:
        TrainingError: If no number is known, times are not in seconds, or signals are too large.
    """

    source: str
    channels: tuple[str, ...]
    time: Float
    ohm: Float | None
    change: Float | None
    notes: tuple[str, ...] = ()

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
    """Read signals from a table in text.

    The table has a column `time`, in s, and one for each channel: (R - R0)/R0 under its name, or
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
    names = [n for n in table.names if n not in OTHER_COLUMNS and n != RUN]
    series = make_series(str(path), names, table["time"], table.columns(names))
    return replace(series, notes=table.notes)


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
