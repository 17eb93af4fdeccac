"""The device in three dimensions: its surface, its cords by their strain, its markers by their
uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ..frames.live_frame import LiveFrame, Quality
from .camera import look_at_body
from .cord_mesh import carrying_weights, tube_faces, tube_vertices

# What a view shows of a device besides its frames.


@dataclass(frozen=True)
class ViewedDevice:
    """The surface at rest: `vertices` (v, 3) mm and `faces` (f, 3); none where only markers are
    known. `cords` by name, each (p, 3) mm at rest. Of the c `channels`, signals in training were
    from `low` (c,) to `high` (c,); marker intervals were usually `radius` mm wide."""

    name: str
    vertices: Float | None
    faces: Int | None
    channels: tuple[str, ...]
    cords: tuple[Float, ...]
    cord_radius: float
    low: Float
    high: Float
    radius: float


# Colours of cords and markers, as (n, 3) from 0 to 255.

#: The body by how far its shape is to be believed.
BODY = {
    Quality.TRUSTED: (120, 170, 215),
    Quality.UNTRAINED: (225, 185, 95),
    Quality.FALLBACK: (225, 145, 95),
    Quality.LOST: (150, 150, 150),
}
_SHORTER, _REST, _LONGER = (40, 90, 200), (225, 225, 225), (205, 35, 45)
#: Of the cords' signals over time, told apart by colour-blind people, too (Okabe & Ito 2008).
LINES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")
#: Markers as cameras saw them.
TRACKS = (20, 20, 20)
_SURE, _UNSURE = (40, 150, 80), (215, 40, 60)


def cord_color(signal: float, low: float, high: float) -> tuple[int, int, int]:
    """Blue where resistance falls, red where it rises, as far as it went in training."""
    if not np.isfinite(signal):
        return 90, 90, 90
    end, limit = (_LONGER, high) if signal > 0 else (_SHORTER, low)
    return _mixed(_REST, end, signal / limit if limit else 0.0)


def marker_colors(radius: Float, usual: float) -> Int:
    """Green where intervals are as wide as usual, red where they are three times that."""
    share = np.clip((np.nan_to_num(radius, nan=3 * usual) / max(usual, 1e-9) - 1) / 2, 0, 1)
    out = np.array(_SURE) + share[:, None] * (np.array(_UNSURE) - np.array(_SURE))
    return np.asarray(np.rint(out), dtype=np.uint8)


def _mixed(a: tuple[int, ...], b: tuple[int, ...], share: float) -> tuple[int, int, int]:
    x = min(max(share, 0.0), 1.0)
    r, g, blue = (round(p + x * (q - p)) for p, q in zip(a, b, strict=True))
    return r, g, blue


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
