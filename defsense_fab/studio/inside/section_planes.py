"""Planes that are chosen by a button, and where a plane is in a body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane

#: Normals and x axes of the planes square to X, Y and Z, with z up wherever it is in the plane.
_FRAMES = (
    ([1.0, 0, 0], [0, 1.0, 0]),
    ([0, -1.0, 0], [1.0, 0, 0]),
    ([0, 0, 1.0], [1.0, 0, 0]),
)


def axis_plane(vertices: Float, axis: int) -> Plane:
    """Through the middle of a body's vertices (v, 3) mm, square to X (0), Y (1) or Z (2)."""
    normal, x = _FRAMES[axis]
    return Plane.from_normal(middle_of(vertices), np.array(normal), np.array(x))


def first_plane(vertices: Float) -> Plane:
    """Square to the axis along which the body is thinnest."""
    return axis_plane(vertices, int(np.ptp(vertices, axis=0).argmin()))


def first_state(states: Sequence[Mapping[str, float]]) -> int:
    """The first in which a single pose is at its largest, of how much of each pose states have;
    rest where there is none."""
    most = max((abs(w) for state in states for w in state.values()), default=0.0)
    full = (k for k, s in enumerate(states) if len(s) == 1 and most in map(abs, s.values()))
    return next(full, 0)


def middle_of(vertices: Float) -> Float:
    """The middle (3,) of the box around vertices (v, 3)."""
    return np.asarray((vertices.min(axis=0) + vertices.max(axis=0)) / 2)


def offsets(plane: Plane, vertices: Float) -> tuple[float, float, float]:
    """How far the plane is from the body's middle along its normal, and the least and the greatest
    that meet its vertices (v, 3); mm."""
    middle = middle_of(vertices)
    along = (vertices - middle) @ plane.normal
    return float((plane.origin - middle) @ plane.normal), float(along.min()), float(along.max())
