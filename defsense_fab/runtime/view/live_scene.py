"""The device in three dimensions: its surface, its cords by their strain, its markers by their
uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.arrays import Float
from ..frames.live_frame import LiveFrame
from .carried_points import carrying_weights
from .colors import BODY, TRACKS, cord_color, marker_colors
from .first_look import look_at_body
from .tube import tube_faces, tube_vertices
from .viewed_device import ViewedDevice

_CORD_POINTS = 40
_MARKER = 0.013  # of the body's diagonal


class LiveScene:
    """Under `name` in a viser server's scene; with `look`, browsers look at it as they come."""

    def __init__(
        self, server: Any, device: ViewedDevice, name: str = "/device", *, look: bool = True
    ) -> None:
        self._device, self._mesh = device, None
        scene = server.scene
        self._root = scene.add_frame(name, show_axes=False)
        scene.set_up_direction("+z")
        size = 100.0
        if device.vertices is not None and device.faces is not None:
            low, high = device.vertices.min(axis=0), device.vertices.max(axis=0)
            size = float(np.linalg.norm(high - low))
            self._mesh = scene.add_mesh_simple(
                f"{name}/surface", device.vertices.astype(np.float32),
                device.faces.astype(np.uint32), color=(120, 170, 215), opacity=0.55, side="double",
            )  # fmt: skip
            scene.add_grid(
                f"{name}/ground", width=2 * size, height=2 * size, cell_size=10.0,
                section_size=50.0, position=(*((low + high) / 2)[:2], float(low[2] - 0.05 * size)),
            )  # fmt: skip
            if look:
                look_at_body(server, device.vertices)
        self._marker_size = _MARKER * size
        self._cords = self._carried()
        self._tubes = [
            scene.add_mesh_simple(
                f"{name}/{channel}",
                tube_vertices(rest, device.cord_radius).astype(np.float32),
                tube_faces(len(rest)).astype(np.uint32),
                color=cord_color(0.0, -1.0, 1.0),
            )
            for channel, (rest, _) in zip(device.channels, self._cords, strict=False)
        ]
        self._markers: Any = None
        self._tracks: Any = None
        self._name, self._scene = name, scene

    @property
    def visible(self) -> bool:
        """Whether all of it is shown."""
        return bool(self._root.visible)

    @visible.setter
    def visible(self, shown: bool) -> None:
        self._root.visible = shown

    def close(self) -> None:
        """Take it out of the scene."""
        self._root.remove()

    def show(self, frame: LiveFrame) -> None:
        """One frame."""
        device = self._device
        if self._mesh is not None and frame.vertices is not None and device.vertices is not None:
            self._mesh.vertices = frame.vertices.astype(np.float32)
            self._mesh.color = BODY[frame.quality]
            moved = frame.vertices - device.vertices
            for k, (tube, (rest, weights)) in enumerate(zip(self._tubes, self._cords, strict=True)):
                tube.vertices = tube_vertices(rest + weights @ moved, device.cord_radius).astype(
                    np.float32
                )
                signal, low, high = frame.signals[k], device.low[k], device.high[k]
                tube.color = cord_color(float(signal), float(low), float(high))
        colors = marker_colors(frame.radius, device.radius)
        points = frame.markers.astype(np.float32)
        if self._markers is None:
            self._markers = self._scene.add_point_cloud(
                f"{self._name}/markers", points, colors, point_size=self._marker_size,
                point_shape="circle", precision="float32",
            )  # fmt: skip
        else:
            self._markers.points, self._markers.colors = points, colors
        if frame.tracks is not None:
            self._show_tracks(frame.tracks)

    def _show_tracks(self, tracks: Float) -> None:
        """Where cameras saw the markers, in black."""
        seen = tracks[np.isfinite(tracks).all(axis=1)].astype(np.float32)
        if self._tracks is None and len(seen):
            self._tracks = self._scene.add_point_cloud(
                f"{self._name}/tracks", seen, TRACKS, point_size=0.7 * self._marker_size,
                point_shape="diamond", precision="float32",
            )  # fmt: skip
        elif self._tracks is not None:
            self._tracks.points = seen

    def _carried(self) -> list[tuple[Float, Any]]:
        device = self._device
        if device.vertices is None:
            return []
        out = []
        for path in device.cords:
            some = np.linspace(0, len(path) - 1, min(_CORD_POINTS, len(path))).round().astype(int)
            out.append((path[some], carrying_weights(path[some], device.vertices)))
        return out
