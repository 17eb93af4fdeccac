"""The handle of the section's plane."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...workflow.view import quaternion, rotation_matrix

_HANDLE_NAME = "/inside/plane"
#: Called with the dragged plane and whether the drag has ended.
PlaneCallback = Callable[[Plane, bool], None]


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
