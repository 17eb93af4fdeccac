"""The handle by which the section's plane is moved and turned."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.arrays import Float
from ...core.curve import Plane

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
