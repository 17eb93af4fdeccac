"""Planes that are chosen by a button, and where a plane is in a body."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.arrays import Float
from ...core.curve import Plane

# The handle by which the section's plane is moved and turned.

_NAME = "/inside/plane"
#: Called with the plane as the hand has it, and whether it has let go.
Moved = Callable[[Plane, bool], None]


class PlaneGizmo:
    """In a viser server's scene; arrows move the plane, arcs turn it."""

    def __init__(self, server: Any, size: float, plane: Plane, moved: Moved) -> None:
        """For a body of a `size` mm."""
        self._handle = server.scene.add_transform_controls(
            _NAME, scale=0.22 * size, line_width=3.0, disable_sliders=True, depth_test=False,
            opacity=0.8, wxyz=_quaternion(plane.axes), position=tuple(plane.origin.tolist()),
        )  # fmt: skip
        self._moved = moved
        self._handle.on_update(self._dragged)

    def place(self, plane: Plane) -> None:
        """Where another plane was chosen."""
        self._handle.position = tuple(plane.origin.tolist())
        self._handle.wxyz = _quaternion(plane.axes)

    def remove(self) -> None:
        self._handle.remove()

    def _dragged(self, event: Any) -> None:
        if event.client is None:  # placed by the page itself
            return
        self._moved(
            plane_at(np.array(self._handle.position, float), self._handle.wxyz),
            event.phase == "end",
        )


def plane_at(origin: Float, wxyz: Float) -> Plane:
    """The plane of a handle's place and turn; its normal is the handle's z."""
    w, x, y, z = np.asarray(wxyz, float).tolist()
    axes = Rotation.from_quat([x, y, z, w]).as_matrix()
    return Plane.from_normal(origin, axes[:, 2], axes[:, 0])


def _quaternion(axes: Float) -> tuple[float, float, float, float]:
    """w, x, y, z of a rotation (3, 3)."""
    x, y, z, w = Rotation.from_matrix(axes).as_quat().tolist()
    return w, x, y, z


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
