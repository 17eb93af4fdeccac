"""What a study has found so far, in `study.json`, so that it can go on from there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.errors import StorageError
from ...core.storage import typed_json
from ...optimize.search.starting_layouts import Layout
from ...store.layout import CordPath


@dataclass(frozen=True)
class Row:
    """RMSE in mm of the best layout of up to so many cords: on unseen states with the read-out's
    noise, on the states that it was designed on with it and without, the floor of affine
    maps over all states; the decoder that it is for.

    Layouts grow out of those before: a row belongs to the chain that was `begun` at some number.
    """

    sensors: int
    unseen: float
    rmse: float
    rmse_noise_free: float
    floor: float
    decoder: str
    begun: int
    layout: Layout


def read_rows(path: Path, key: str) -> list[Row]:
    """Rows found for the same input, told by `key`; none if the file is another's or damaged."""
    try:
        found = typed_json.load(path, _StudyRecord, "it is begun anew")
    except StorageError:
        return []
    return [_read(r) for r in found.rows] if found.key == key else []


def write_rows(path: Path, key: str, rows: list[Row]) -> None:
    """The rows, whole or not at all. Raises StorageError."""
    typed_json.save(path, _StudyRecord(key, tuple(_write(r) for r in rows)))


@dataclass(frozen=True)
class _StudiedCord(CordPath):
    """With the plane's axes (3, 3) as they were: to go on from rounded ones need not lead to the
    same layouts."""

    axes: Float


@dataclass(frozen=True)
class _RowRecord:
    """A `Row` in `study.json`."""

    sensors: int
    unseen: float
    rmse: float
    rmse_noise_free: float
    floor: float
    decoder: str
    begun: int
    layout: tuple[_StudiedCord, ...]


@dataclass(frozen=True)
class _StudyRecord:
    """`study.json`: the rows, and the hash of what they were found for."""

    SCHEMA: ClassVar[int] = 2

    key: str
    rows: tuple[_RowRecord, ...]


def _read(record: _RowRecord) -> Row:
    layout = tuple(replace(c.sensor(), plane=Plane(c.plane.origin, c.axes)) for c in record.layout)
    return Row(**{**vars(record), "layout": layout})


def _write(row: Row) -> _RowRecord:
    layout = tuple(_StudiedCord(**vars(CordPath.of(s)), axes=s.plane.axes) for s in row.layout)
    return _RowRecord(**{**vars(row), "layout": layout})


def chain(rows: list[Row], least: int) -> list[Row]:
    """Of the chains without gaps that were begun at `least` or below and reach it, the one that
    goes furthest: a study of `least` and more goes on from its end."""
    best: list[Row] = []
    for begun in sorted({r.begun for r in rows if r.begun <= least}):
        own = {r.sensors: r for r in rows if r.begun == begun}
        run: list[Row] = []
        while begun + len(run) in own:
            run.append(own[begun + len(run)])
        last = best[-1].sensors if best else least - 1
        if run and run[-1].sensors > last:
            best = run
    return best
