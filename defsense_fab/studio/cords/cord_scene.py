"""The device's cords in the scene, and the handles of the chosen cord."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal
from urllib.parse import quote

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane, catmull_rom, sample_path
from ...core.device.device import Sensor
from ...workflow.view import quaternion, rotation_matrix
from ..workbench.cord_tubes import add_tube, tube_mesh

_CORD_COLOR, _CHOSEN_COLOR, _BROKEN_COLOR = (70, 70, 75), (31, 119, 180), (214, 39, 40)
_SPOT_SIZE = 1.6  # times the cord's radius
_TANGENT_SCALE = 3.0  # tangents are this much longer than their handles, as in drawing programs
_AUTO_TANGENT_TOLERANCE_MM = 1e-3  # within which tangents count as computed from the points

#: What the handles of the chosen cord move.
HandleKind = Literal["points", "tangents", "plane"]
HANDLE_KINDS: tuple[HandleKind, ...] = ("points", "tangents", "plane")
#: Called with the dragged cord, the kind of handle, its index, and whether the drag has ended.
#: Returns the cord to draw, which may be snapped.
DragCallback = Callable[[Sensor, HandleKind, int, bool], Sensor]


def with_point(sensor: Sensor, index: int, point: Float) -> Sensor:
    """Return the cord with a control point moved to `point` (2,) mm.

    Tangents that were computed from the points are computed again.
    """
    points, tangents = sensor.curve.points.copy(), sensor.curve.tangents
    is_smooth = np.allclose(tangents, catmull_rom(points), atol=_AUTO_TANGENT_TOLERANCE_MM)
    points[index] = point
    return replace(sensor, curve=Hermite(points, catmull_rom(points) if is_smooth else tangents))


def with_tangent(sensor: Sensor, index: int, tangent: Float) -> Sensor:
    """Return the cord with another tangent (2,) mm at a control point."""
    tangents = sensor.curve.tangents.copy()
    tangents[index] = tangent
    return replace(sensor, curve=Hermite(sensor.curve.points, tangents))


class CordScene:
    """Draw the cords of a device in a viser server's scene.

    Args:
        server: The viser server.
        radius: Radius of the cords, mm.
        size: Size of the body, mm.
        on_drag: Called while a handle is dragged and once it is released.
    """

    def __init__(self, server: Any, radius: float, size: float, on_drag: DragCallback) -> None:
        self._scene, self._radius, self._size, self._on_drag = server.scene, radius, size, on_drag
        self._lock = threading.RLock()  # handles, edits and checks have threads of their own
        self._tubes: dict[str, Any] = {}
        self._handles: list[Any] = []
        self._arms: Any = None
        self._spots: Any = None
        self._chosen: Sensor | None = None
        self._kind: HandleKind = "points"

    def show(self, sensors: Sequence[Sensor], chosen: str | None, kind: HandleKind) -> None:
        """Draw all cords, with handles of this kind on the chosen one."""
        with self._lock:
            for tube in self._tubes.values():
                tube.remove()
            self._tubes = {s.name: self._add_tube(s, chosen) for s in sensors}
            self._chosen = next((s for s in sensors if s.name == chosen), None)
            self._kind = kind
            self._place_handles()

    def clear(self) -> None:
        """Remove all cords, handles and marks."""
        self.show((), None, "points")
        self.mark(np.zeros((0, 3)), frozenset())

    def move(self, sensor: Sensor) -> None:
        """Redraw one cord that is being dragged, without its handles."""
        with self._lock:
            tube = self._tubes.get(sensor.name)
            if tube is not None:
                tube.vertices = tube_mesh(sample_path(sensor), self._radius)[0]

    def mark(self, points: Float, broken: frozenset[str]) -> None:
        """Mark broken limits in red.

        Args:
            points: (b, 3) mm, where limits are broken.
            broken: Names of the cords that break them.
        """
        with self._lock:
            if self._spots is not None:
                self._spots.remove()
                self._spots = None
            if len(points):
                self._spots = self._scene.add_point_cloud(
                    "/cords-broken",
                    points,
                    colors=_BROKEN_COLOR,
                    point_size=_SPOT_SIZE * self._radius,
                    point_shape="circle",
                )
            chosen = None if self._chosen is None else self._chosen.name
            for name, tube in self._tubes.items():
                color = _CHOSEN_COLOR if name == chosen else _CORD_COLOR
                if name in broken:
                    color = _BROKEN_COLOR
                if tuple(tube.color) != color:
                    tube.color = color

    def _add_tube(self, sensor: Sensor, chosen: str | None) -> Any:
        color = _CHOSEN_COLOR if sensor.name == chosen else _CORD_COLOR
        name = f"/cords/{quote(sensor.name, safe='')}"
        return add_tube(self._scene, name, sample_path(sensor), self._radius, color)

    def _place_handles(self) -> None:
        for handle in self._handles:
            handle.remove()
        self._handles = []
        if self._chosen is not None:
            rotation = quaternion(self._chosen.plane.axes)
            is_plane = self._moves_plane(self._chosen)
            is_planar = self._chosen.curve.is_planar
            for index, position in enumerate(self._handle_positions(self._chosen)):
                handle = self._scene.add_transform_controls(
                    f"/handles/{index}",
                    scale=(0.18 if is_plane else 0.07) * self._size,
                    line_width=3.0,
                    active_axes=(True, True, is_plane or not is_planar),
                    disable_rotations=not is_plane,
                    depth_test=False,
                    wxyz=rotation,
                    position=position,
                )
                handle.on_update(self._drag_callback(index, handle))
                self._handles.append(handle)
        self._show_arms()

    def _handle_positions(self, sensor: Sensor) -> Float:
        """Return the positions of the handles (k, 3) mm."""
        points = sensor.curve.points
        if self._moves_plane(sensor):
            return sensor.plane.to_world(points.mean(axis=0, keepdims=True))
        if self._kind == "tangents":
            return sensor.plane.to_world(points + sensor.curve.tangents / _TANGENT_SCALE)
        return sensor.plane.to_world(points)

    def _moves_plane(self, sensor: Sensor) -> bool:
        """Return whether handles move a cord's plane; a path in space has none."""
        return self._kind == "plane" and sensor.curve.is_planar

    def _show_arms(self) -> None:
        """Draw lines from the control points to the handles of their tangents."""
        if self._arms is not None:
            self._arms.remove()
            self._arms = None
        if self._chosen is not None and self._kind == "tangents":
            points = self._chosen.plane.to_world(self._chosen.curve.points)
            ends = np.stack([points, self._handle_positions(self._chosen)], axis=1)
            self._arms = self._scene.add_line_segments(
                "/handle-arms",
                ends,
                colors=_CHOSEN_COLOR,
                thickness=2.0,
                thickness_units="screen",
            )

    def _drag_callback(self, index: int, handle: Any) -> Callable[[Any], Any]:
        async def on_update(event: Any) -> None:
            has_ended = event.phase == "end"
            with self._lock:
                if self._chosen is None:
                    return
                dragged = self._dragged_cord(self._chosen, index, handle)
            if has_ended:  # the file is written, which must not block the page
                await asyncio.to_thread(self._on_drag, dragged, self._kind, index, True)
                return
            dragged = self._on_drag(dragged, self._kind, index, False)
            with self._lock:
                if self._chosen is not None and self._chosen.name == dragged.name:
                    self._chosen = dragged
                    self._show_arms()

        return on_update

    def _dragged_cord(self, sensor: Sensor, index: int, handle: Any) -> Sensor:
        position = np.asarray(handle.position, float)
        if self._moves_plane(sensor):
            axes = rotation_matrix(handle.wxyz)
            middle = sensor.curve.points.mean(axis=0)
            return replace(sensor, plane=Plane(position - axes[:, :2] @ middle, axes))
        axes = sensor.plane.axes[:, : sensor.curve.points.shape[1]]
        point = (position - sensor.plane.origin) @ axes
        if self._kind == "tangents":
            return with_tangent(
                sensor, index, _TANGENT_SCALE * (point - sensor.curve.points[index])
            )
        return with_point(sensor, index, point)
