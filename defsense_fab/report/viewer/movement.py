"""The poses that are played: the simulated shapes on the way to each, and what is read of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.mesh import TetMesh
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ..surface_errors import SurfaceErrors, state_words


@dataclass(frozen=True)
class PosePath:
    """From rest to a state: the states (k,) on the way, the state itself last, and how far along
    it they are (k,), up to 1; whether the device was not designed for the state."""

    name: str
    states: Int
    at: Float
    held_out: bool


def pose_paths(found: SurfaceErrors) -> list[PosePath]:
    """Of the states that reports show."""
    return [_path(found, i) for i in found.shown]


def _path(found: SurfaceErrors, state: int) -> PosePath:
    """All states that have the same poses in the same ratio and are not further along."""
    full = found.weights[state]
    at = {k: _fraction(weights, full) for k, weights in enumerate(found.weights)}
    on = sorted((a, k) for k, a in at.items() if a is not None and (a < 1 or k == state))
    return PosePath(
        state_words(full),
        np.array([k for _, k in on]),
        np.array([a for a, _ in on]),
        bool(found.held_out[state]),
    )


def _fraction(weights: Mapping[str, float], full: Mapping[str, float]) -> float | None:
    """How far along the way to `full` a state is; None where it lies on another way."""
    if {p for p, w in weights.items() if w} != {p for p, w in full.items() if w}:
        return None
    some = [weights[pose] / w for pose, w in full.items() if w]
    least, most = min(some), max(some)
    return least if 0 < least <= 1 + 1e-9 and most - least < 1e-6 else None


def moved_points(mesh: TetMesh, points: Float, fields: Float) -> Float:
    """Where points (p, 3) mm of the body at rest go in states with fields (k, n, 3) mm of its mesh:
    their displacements (k, p, 3) mm."""
    locator = PointLocator(QuadraticMesh.from_linear(mesh))
    return locator.displacement(locator.find(points), np.ascontiguousarray(fields))
