"""Cords in three dimensions, and the handles by which the chosen one is drawn."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, catmull_rom
from ...core.device import Sensor
from ...core.path_sampling import sample_path
from ...runtime.view.tube import tube_faces, tube_vertices

_SAMPLES = 120  # points of a tube
_PLAIN, _CHOSEN, _BROKEN = (70, 70, 75), (31, 119, 180), (214, 39, 40)
#: Called with the cord as it is drawn now, and whether the hand has let go.
Drawn = Callable[[Sensor, int, bool], None]


def with_point(sensor: Sensor, at: int, place: Float) -> Sensor:
    """The cord with a control point (2,) mm elsewhere; tangents that follow from the points still
    do."""
    points, tangents = sensor.curve.points.copy(), sensor.curve.tangents
    smooth = np.allclose(tangents, catmull_rom(points), atol=1e-3)
    points[at] = place
    return Sensor(
        sensor.name, sensor.plane, Hermite(points, catmull_rom(points) if smooth else tangents),
        sensor.free,
    )  # fmt: skip


class CordScene:
    """The cords of a device in a viser server's scene."""

    def __init__(self, server: Any, radius: float, size: float, drawn: Drawn) -> None:
        """Cords of a `radius` mm in a body of a `size` mm; `drawn` hears of what hands do."""
        self._scene, self._radius, self._size, self._drawn = server.scene, radius, size, drawn
        self._lock = threading.RLock()  # hands, edits and checks come from threads of their own
        self._tubes: dict[str, Any] = {}
        self._handles: list[Any] = []
        self._chosen: Sensor | None = None

    def show(self, sensors: Sequence[Sensor], chosen: str | None, broken: frozenset[str]) -> None:
        """All cords anew, with handles on the `chosen` one; those that break a limit in red."""
        with self._lock:
            for tube in self._tubes.values():
                tube.remove()
            self._tubes = {s.name: self._tube(s, chosen, broken) for s in sensors}
            self._chosen = next((s for s in sensors if s.name == chosen), None)
            self._place_handles()

    def move(self, sensor: Sensor) -> None:
        """One cord as it is drawn now; its handles are where the hand has them."""
        with self._lock:
            tube = self._tubes.get(sensor.name)
            if tube is not None:
                tube.vertices = self._vertices(sensor)

    def _tube(self, sensor: Sensor, chosen: str | None, broken: frozenset[str]) -> Any:
        color = _CHOSEN if sensor.name == chosen else _PLAIN
        vertices = self._vertices(sensor)
        return self._scene.add_mesh_simple(
            f"/cords/{sensor.name}", vertices, tube_faces(len(vertices) // 8).astype(np.uint32),
            color=_BROKEN if sensor.name in broken else color,
        )  # fmt: skip

    def _vertices(self, sensor: Sensor) -> Float:
        path = sample_path(sensor)
        some = np.linspace(0, len(path) - 1, min(_SAMPLES, len(path))).round().astype(int)
        return tube_vertices(path[some], self._radius).astype(np.float32)

    def _place_handles(self) -> None:
        for handle in self._handles:
            handle.remove()
        self._handles = []
        if self._chosen is None:
            return
        sensor = self._chosen
        turn = _quaternion(sensor.plane.axes)
        for at, place in enumerate(sensor.plane.to_world(sensor.curve.points)):
            handle = self._scene.add_transform_controls(
                f"/handles/{at}", scale=0.07 * self._size, line_width=3.0,
                active_axes=(True, True, False), disable_rotations=True, depth_test=False,
                wxyz=turn, position=tuple(place.tolist()),
            )  # fmt: skip
            handle.on_update(self._dragged(at, handle))
            self._handles.append(handle)

    def _dragged(self, at: int, handle: Any) -> Callable[[Any], None]:
        def moved(event: Any) -> None:
            if self._chosen is None:
                return
            plane = self._chosen.plane
            place = (np.asarray(handle.position, float) - plane.origin) @ plane.axes[:, :2]
            self._chosen = with_point(self._chosen, at, place)
            self._drawn(self._chosen, at, event.phase == "end")

        return moved


def _quaternion(axes: Float) -> tuple[float, float, float, float]:
    """w, x, y, z of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(axes).as_quat().tolist()
    return w, x, y, z
