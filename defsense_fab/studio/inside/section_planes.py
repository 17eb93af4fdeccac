"""The plane of the section: default planes, its offset in the body, and its handle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...workflow.view import quaternion, rotation_matrix

_HANDLE_NAME = "/inside/plane"
#: Normals and x axes of the planes normal to X, Y and Z, with z up where it lies in the plane.
_AXIS_FRAMES = (
    ([1.0, 0, 0], [0, 1.0, 0]),
    ([0, -1.0, 0], [1.0, 0, 0]),
    ([0, 0, 1.0], [1.0, 0, 0]),
)
#: Called with the dragged plane and whether the drag has ended.
PlaneCallback = Callable[[Plane, bool], None]


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


def plane_at(origin: Float, wxyz: Float) -> Plane:
    """Return the plane of a handle's position (3,) mm and rotation; its normal is the handle's z.

    Args:
        origin: Position of the handle.
        wxyz: Quaternion of its rotation.
    """
    axes = rotation_matrix(wxyz)
    return Plane.from_normal(origin, axes[:, 2], axes[:, 0])


class PlaneGizmo:
    """Handle in a viser server's scene; its arrows move the plane and its arcs turn it.

    Args:
        server: The viser server.
        size: Size of the body, mm.
        plane: The plane to start with.
        on_moved: Called while a user drags the handle.
    """

    def __init__(self, server: Any, size: float, plane: Plane, on_moved: PlaneCallback) -> None:
        self._handle = server.scene.add_transform_controls(
            _HANDLE_NAME,
            scale=0.22 * size,
            line_width=3.0,
            disable_sliders=True,
            depth_test=False,
            opacity=0.8,
            wxyz=quaternion(plane.axes),
            position=plane.origin,
        )
        self._on_moved = on_moved
        self._handle.on_update(self._follow)

    def place(self, plane: Plane) -> None:
        """Move the handle to another plane."""
        self._handle.position = plane.origin
        self._handle.wxyz = quaternion(plane.axes)

    def remove(self) -> None:
        """Remove the handle from the scene."""
        self._handle.remove()

    def _follow(self, event: Any) -> None:
        if event.client is None:  # placed by the program, not by a user
            return
        position = np.array(self._handle.position, float)
        self._on_moved(plane_at(position, self._handle.wxyz), event.phase == "end")
