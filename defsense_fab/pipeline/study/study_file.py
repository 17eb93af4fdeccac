"""What a study has found so far, in `study.json`, so that it can go on from there."""

from __future__ import annotations

import operator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.curve import Plane
from ...core.files import write_json
from ...optimize.search.starting_layouts import Layout
from ..artifacts.layout import read_sensor, write_sensor
from ..build.stages import read_json


@dataclass(frozen=True)
class Row:
    """RMSE in mm of the best layout of up to so many cords: on the states that it was designed on,
    with the read-out's noise and without, on those held out (nan without any); the affine floor.

    Layouts grow out of those before: a row belongs to the chain that was `begun` at some number.
    """

    sensors: int
    rmse: float
    rmse_noise_free: float
    held_out: float
    floor: float
    begun: int
    layout: Layout


def read_rows(path: Path, key: str) -> list[Row]:
    """Rows found for the same input, told by `key`; none if the file is another's or damaged."""
    try:
        data = read_json(path)
        if data["schema"] != 1 or data["key"] != key:
            return []
        return [_read(r) for r in data["rows"]]
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError):
        return []


def write_rows(path: Path, key: str, rows: list[Row]) -> None:
    write_json(path, {"schema": 1, "key": key, "rows": [_write(r) for r in rows]})


def _read(data: dict[str, Any]) -> Row:
    # The axes as they were: to go on from rounded ones need not lead to the same layouts.
    layout = tuple(
        replace(s, plane=Plane(s.plane.origin, np.array(d["axes"])))
        for s, d in ((read_sensor(d), d) for d in data["layout"])
    )
    return Row(
        sensors=operator.index(data["sensors"]),
        rmse=float(data["rmse"]),
        rmse_noise_free=float(data["rmse_noise_free"]),
        held_out=float("nan") if data["held_out"] is None else float(data["held_out"]),
        floor=float(data["floor"]),
        begun=operator.index(data["begun"]),
        layout=layout,
    )


def _write(row: Row) -> dict[str, Any]:
    layout = [{**write_sensor(s), "axes": s.plane.axes.tolist()} for s in row.layout]
    held_out = None if np.isnan(row.held_out) else row.held_out
    return {**vars(row), "held_out": held_out, "layout": layout}


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
