"""Tables of numbers in CSV files, by the names of their columns."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError

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
