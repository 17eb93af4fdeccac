"""What a study has found so far, in `study.json`, so that it can go on from there."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.files import write_json
from .stages import read_json


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
    layout: list[dict[str, Any]]


def read_rows(path: Path, key: str) -> list[Row]:
    """Rows found for the same input, told by `key`; none if the file is another's or damaged."""
    try:
        data = read_json(path)
        if data["schema"] != 1 or data["key"] != key:
            return []
        nan = float("nan")
        return [
            Row(**{**r, "held_out": nan if r["held_out"] is None else r["held_out"]})
            for r in data["rows"]
        ]
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return []


def write_rows(path: Path, key: str, rows: list[Row]) -> None:
    out = [asdict(r) for r in rows]
    for r in out:
        r["held_out"] = None if np.isnan(r["held_out"]) else r["held_out"]
    write_json(path, {"schema": 1, "key": key, "rows": out})


def chain(rows: list[Row], least: int) -> list[Row]:
    """Of the chains without gaps that were begun at `least` or below and reach it, the longest:
    a study of `least` and more goes on from its end."""
    best: list[Row] = []
    for begun in {r.begun for r in rows if r.begun <= least}:
        own = {r.sensors: r for r in rows if r.begun == begun}
        run: list[Row] = []
        while begun + len(run) in own:
            run.append(own[begun + len(run)])
        if begun + len(run) > least and len(run) > len(best):
            best = run
    return best
