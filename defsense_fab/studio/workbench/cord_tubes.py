"""Cords drawn as tubes that cannot be edited."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

import numpy as np

from ...core.arrays import Float
from ...core.curve import sample_path
from ...core.device.device import Sensor
from ...workflow.view import tube_faces, tube_vertices

Color = tuple[int, int, int]

_MAX_TUBE_POINTS = 120  # of a longer path, evenly chosen


def tube_mesh(path: Float, radius: float) -> tuple[Any, Any]:
    """Return the vertices and the triangles of a tube around a path, as viser takes them.

    Args:
        path: The path (p, 3) mm.
        radius: Radius of the tube, mm.
    """
    count = min(_MAX_TUBE_POINTS, len(path))
    indices = np.linspace(0, len(path) - 1, count).round().astype(int)
    vertices = tube_vertices(path[indices], radius).astype(np.float32)
    return vertices, tube_faces(count).astype(np.uint32)


def add_tube(
    scene: Any, name: str, path: Float, radius: float, color: Color, **options: Any
) -> Any:
    """Add a tube to a scene of viser and return its handle.

    Args:
        scene: The scene.
        name: Path of the tube in the scene.
        path: The path (p, 3) mm.
        radius: Radius of the tube, mm.
        color: RGB color, 0 to 255.
        options: Further arguments of `add_mesh_simple`.
    """
    vertices, faces = tube_mesh(path, radius)
    return scene.add_mesh_simple(name, vertices, faces, color=color, **options)


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
            tube, path = self._tubes.get(sensor.name), sample_path(sensor)
            if tube is None:
                name = f"{self._name}/{quote(sensor.name, safe='')}"
                self._tubes[sensor.name] = add_tube(
                    self._scene, name, path, radius, color, side="double"
                )
            else:
                tube.vertices, tube.color = tube_mesh(path, radius)[0], color

    def clear(self) -> None:
        """Remove all tubes."""
        self.show((), (0, 0, 0), 1.0)
