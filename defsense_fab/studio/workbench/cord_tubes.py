"""Cords drawn as tubes that cannot be edited."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

import numpy as np

from ...core.curve import sample_path
from ...core.device.device import Sensor
from ...runtime.view.cord_mesh import tube_faces, tube_vertices

_POINTS_PER_TUBE = 80

Color = tuple[int, int, int]


class CordTubes:
    """Tubes under one name of a viser server's scene.

    Call the methods while the workbench's `drawing_lock` is held.

    Args:
        server: The viser server.
        name: Path of the tubes in the scene.
    """

    def __init__(self, server: Any, name: str) -> None:
        self._scene, self._name = server.scene, name
        self._tubes: dict[str, Any] = {}

    @property
    def names(self) -> set[str]:
        """Names of the cords that are drawn."""
        return set(self._tubes)

    def show(self, sensors: Sequence[Sensor], color: Color, radius: float) -> None:
        """Draw these cords with a `radius` in mm, and remove all others."""
        for name in set(self._tubes) - {s.name for s in sensors}:
            self._tubes.pop(name).remove()
        for sensor in sensors:
            vertices = self._vertices(sensor, radius)
            tube = self._tubes.get(sensor.name)
            if tube is None:
                self._tubes[sensor.name] = self._scene.add_mesh_simple(
                    f"{self._name}/{quote(sensor.name, safe='')}",
                    vertices,
                    tube_faces(len(vertices) // 8).astype(np.uint32),
                    color=color,
                    side="double",
                )
            else:
                tube.vertices, tube.color = vertices, color

    def clear(self) -> None:
        """Remove all tubes."""
        self.show((), (0, 0, 0), 1.0)

    @staticmethod
    def _vertices(sensor: Sensor, radius: float) -> Any:
        path = sample_path(sensor)
        indices = np.linspace(0, len(path) - 1, _POINTS_PER_TUBE).round().astype(int)
        return tube_vertices(path[indices], radius).astype(np.float32)
