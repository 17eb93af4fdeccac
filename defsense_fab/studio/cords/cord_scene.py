"""Cords in three dimensions, and the handles by which the chosen one is drawn."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal
from urllib.parse import quote

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.arrays import Float
from ...core.curve import Hermite, Plane, catmull_rom, sample_path
from ...core.device.device import Sensor
from ...runtime.view.cord_mesh import tube_faces, tube_vertices

_SAMPLES = 120  # points of a tube
_PLAIN, _CHOSEN, _BROKEN = (70, 70, 75), (31, 119, 180), (214, 39, 40)
_SPOT = 1.6  # times the cord's radius
_ARM = 3.0  # a tangent's handle is so much nearer than the tangent is long, as in drawing programs
#: What is dragged of the chosen cord.
Part = Literal["points", "tangents", "plane"]
PARTS: tuple[Part, ...] = ("points", "tangents", "plane")
#: Called with the cord as it is drawn now, what is dragged, which of them, and whether the hand has
#: let go; gives the cord as it is to be.
Drawn = Callable[[Sensor, Part, int, bool], Sensor]


def with_point(sensor: Sensor, at: int, place: Float) -> Sensor:
    """The cord with a control point (2,) mm elsewhere; tangents that follow from the points still
    do."""
    points, tangents = sensor.curve.points.copy(), sensor.curve.tangents
    smooth = np.allclose(tangents, catmull_rom(points), atol=1e-3)
    points[at] = place
    return replace(sensor, curve=Hermite(points, catmull_rom(points) if smooth else tangents))


def with_tangent(sensor: Sensor, at: int, tangent: Float) -> Sensor:
    """The cord with another tangent (2,) mm at a control point."""
    tangents = sensor.curve.tangents.copy()
    tangents[at] = tangent
    return replace(sensor, curve=Hermite(sensor.curve.points, tangents))


class CordScene:
    """The cords of a device in a viser server's scene."""

    def __init__(self, server: Any, radius: float, size: float, drawn: Drawn) -> None:
        """Cords of a `radius` mm in a body of a `size` mm; `drawn` hears of what hands do."""
        self._scene, self._radius, self._size, self._drawn = server.scene, radius, size, drawn
        self._lock = threading.RLock()  # hands, edits and checks come from threads of their own
        self._tubes: dict[str, Any] = {}
        self._handles: list[Any] = []
        self._arms: Any = None
        self._spots: Any = None
        self._chosen: Sensor | None = None
        self._part: Part = "points"

    def show(self, sensors: Sequence[Sensor], chosen: str | None, part: Part) -> None:
        """All cords anew, with handles on a `part` of the `chosen` one."""
        with self._lock:
            for tube in self._tubes.values():
                tube.remove()
            self._tubes = {s.name: self._tube(s, chosen) for s in sensors}
            self._chosen = next((s for s in sensors if s.name == chosen), None)
            self._part = part
            self._place_handles()

    def clear(self) -> None:
        """No cord, and no handle."""
        self.show((), None, "points")
        self.mark(np.zeros((0, 3)), frozenset())

    def move(self, sensor: Sensor) -> None:
        """One cord as it is drawn now; its handles are where the hand has them."""
        with self._lock:
            tube = self._tubes.get(sensor.name)
            if tube is not None:
                tube.vertices = self._vertices(sensor)

    def mark(self, places: Float, broken: frozenset[str]) -> None:
        """Red spots at `places` (b, 3) mm, where limits break, and red for those `broken` cords."""
        with self._lock:
            if self._spots is not None:
                self._spots.remove()
                self._spots = None
            if len(places):
                self._spots = self._scene.add_point_cloud(
                    "/cords-broken", places.astype(np.float32), colors=_BROKEN,
                    point_size=_SPOT * self._radius, point_shape="circle",
                )  # fmt: skip
            chosen = None if self._chosen is None else self._chosen.name
            for name, tube in self._tubes.items():
                color = _BROKEN if name in broken else _CHOSEN if name == chosen else _PLAIN
                if tuple(tube.color) != color:
                    tube.color = color

    def _tube(self, sensor: Sensor, chosen: str | None) -> Any:
        vertices = self._vertices(sensor)
        return self._scene.add_mesh_simple(
            f"/cords/{quote(sensor.name, safe='')}", vertices,
            tube_faces(len(vertices) // 8).astype(np.uint32),
            color=_CHOSEN if sensor.name == chosen else _PLAIN,
        )  # fmt: skip

    def _vertices(self, sensor: Sensor) -> Float:
        path = sample_path(sensor)
        some = np.linspace(0, len(path) - 1, min(_SAMPLES, len(path))).round().astype(int)
        return tube_vertices(path[some], self._radius).astype(np.float32)

    def _place_handles(self) -> None:
        for handle in self._handles:
            handle.remove()
        self._handles = []
        if self._chosen is not None:
            turn = _quaternion(self._chosen.plane.axes)
            for at, place in enumerate(self._places(self._chosen)):
                whole = self._part == "plane"
                handle = self._scene.add_transform_controls(
                    f"/handles/{at}", scale=(0.18 if whole else 0.07) * self._size,
                    line_width=3.0, active_axes=(True, True, whole), disable_rotations=not whole,
                    depth_test=False, wxyz=turn, position=tuple(place.tolist()),
                )  # fmt: skip
                handle.on_update(self._dragged(at, handle))
                self._handles.append(handle)
        self._show_arms()

    def _places(self, sensor: Sensor) -> Float:
        """Where handles are, (k, 3) mm."""
        points = sensor.curve.points
        if self._part == "plane":
            return sensor.plane.to_world(points.mean(axis=0, keepdims=True))
        if self._part == "tangents":
            return sensor.plane.to_world(points + sensor.curve.tangents / _ARM)
        return sensor.plane.to_world(points)

    def _show_arms(self) -> None:
        """From points to the handles of their tangents."""
        if self._arms is not None:
            self._arms.remove()
            self._arms = None
        if self._chosen is not None and self._part == "tangents":
            points = self._chosen.plane.to_world(self._chosen.curve.points)
            ends = np.stack([points, self._places(self._chosen)], axis=1)
            self._arms = self._scene.add_line_segments(
                "/handle-arms",
                ends.astype(np.float32),
                colors=_CHOSEN,
                thickness=2.0,
                thickness_units="screen",
            )

    def _dragged(self, at: int, handle: Any) -> Callable[[Any], Any]:
        async def moved(event: Any) -> None:
            ended = event.phase == "end"
            with self._lock:
                if self._chosen is None:
                    return
                drawn = self._as_dragged(self._chosen, at, handle)
            if ended:  # it is written: that takes a while, and the page goes on meanwhile
                await asyncio.to_thread(self._drawn, drawn, self._part, at, True)
                return
            drawn = self._drawn(drawn, self._part, at, False)
            with self._lock:
                if self._chosen is not None and self._chosen.name == drawn.name:
                    self._chosen = drawn
                    self._show_arms()

        return moved

    def _as_dragged(self, sensor: Sensor, at: int, handle: Any) -> Sensor:
        position = np.asarray(handle.position, float)
        if self._part == "plane":
            w, x, y, z = handle.wxyz
            axes = Rotation.from_quat([x, y, z, w]).as_matrix()
            middle = sensor.curve.points.mean(axis=0)
            return replace(sensor, plane=Plane(position - axes[:, :2] @ middle, axes))
        place = (position - sensor.plane.origin) @ sensor.plane.axes[:, :2]
        if self._part == "tangents":
            return with_tangent(sensor, at, _ARM * (place - sensor.curve.points[at]))
        return with_point(sensor, at, place)


def _quaternion(axes: Float) -> tuple[float, float, float, float]:
    """w, x, y, z of a rotation (3, 3)."""
    x, y, z, w = Rotation.from_matrix(axes).as_quat().tolist()
    return w, x, y, z
