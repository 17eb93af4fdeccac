"""The plane of the section: default planes, and its offset in the body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ....core.arrays import Float
from ....core.curve import Plane

#: Normals and x axes of the planes normal to X, Y and Z, with z up where it lies in the plane.
_AXIS_FRAMES = (
    ([1.0, 0, 0], [0, 1.0, 0]),
    ([0, -1.0, 0], [1.0, 0, 0]),
    ([0, 0, 1.0], [1.0, 0, 0]),
)


def axis_plane(vertices: Float, axis: int) -> Plane:
    """Return the plane through the middle of a body, normal to an axis.

    Args:
        vertices: (v, 3) mm, vertices of the body.
        axis: 0 for X, 1 for Y, 2 for Z.
    """
    normal, x_axis = _AXIS_FRAMES[axis]
    return Plane.from_normal(box_middle(vertices), np.array(normal), np.array(x_axis))


def first_plane(vertices: Float) -> Plane:
    """Return the middle plane normal to the axis along which the body is thinnest."""
    return axis_plane(vertices, int(np.ptp(vertices, axis=0).argmin()))


def first_state(states: Sequence[Mapping[str, float]]) -> int:
    """Return the index of the first state with one pose at its largest weight, else 0 for rest.

    Args:
        states: Weights of the poses in each state.
    """
    largest = max((abs(w) for state in states for w in state.values()), default=0.0)
    full = (k for k, s in enumerate(states) if len(s) == 1 and largest in map(abs, s.values()))
    return next(full, 0)


def box_middle(vertices: Float) -> Float:
    """Return the middle (3,) of the box around vertices (v, 3)."""
    return np.asarray((vertices.min(axis=0) + vertices.max(axis=0)) / 2)


def plane_offsets(plane: Plane, vertices: Float) -> tuple[float, float, float]:
    """Return the plane's offset along its normal and the smallest and largest that meet the body.

    Offsets are in mm from the middle of the body, whose vertices are (v, 3) mm.
    """
    middle = box_middle(vertices)
    heights = (vertices - middle) @ plane.normal
    return float((plane.origin - middle) @ plane.normal), float(heights.min()), float(heights.max())
