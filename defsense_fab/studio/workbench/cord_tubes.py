"""Cords as tubes that are only looked at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

import numpy as np

from ...core.curve import sample_path
from ...core.device.device import Sensor
from ...runtime.view.cord_mesh import tube_faces, tube_vertices

_SAMPLES = 80  # points of a tube

Color = tuple[int, int, int]


class CordTubes:
    """Under a name in a viser server's scene; call it with the workbench's `drawing` lock taken."""

    def __init__(self, server: Any, name: str) -> None:
        self._scene, self._name = server.scene, name
        self._tubes: dict[str, Any] = {}

    def show(self, sensors: Sequence[Sensor], color: Color, radius: float) -> None:
        """These cords, of a `radius` mm, and no others; those that are there move."""
        for gone in set(self._tubes) - {s.name for s in sensors}:
            self._tubes.pop(gone).remove()
        for sensor in sensors:
            vertices = self._vertices(sensor, radius)
            tube = self._tubes.get(sensor.name)
            if tube is None:
                self._tubes[sensor.name] = self._scene.add_mesh_simple(
                    f"{self._name}/{quote(sensor.name, safe='')}", vertices,
                    tube_faces(len(vertices) // 8).astype(np.uint32), color=color, side="double",
                )  # fmt: skip
            else:
                tube.vertices, tube.color = vertices, color

    def clear(self) -> None:
        """None."""
        self.show((), (0, 0, 0), 1.0)

    @staticmethod
    def _vertices(sensor: Sensor, radius: float) -> Any:
        path = sample_path(sensor)
        some = np.linspace(0, len(path) - 1, _SAMPLES).round().astype(int)
        return tube_vertices(path[some], radius).astype(np.float32)
