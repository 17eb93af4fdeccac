"""The device in three dimensions: its surface, its cords colored by signal, and its markers."""

from __future__ import annotations

import itertools
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ...core.arrays import Float, Int
from ..frames.live_frame import LiveFrame, Quality
from .viewed_device import ViewedDevice as ViewedDevice
from .viewed_device import carried_cords
from .viewed_device import skinning_weights as skinning_weights

#: Colors of the body by the quality of the frame, from 0 to 255.
BODY_COLORS = {
    Quality.TRUSTED: (120, 170, 215),
    Quality.UNTRAINED: (225, 185, 95),
    Quality.FALLBACK: (225, 145, 95),
    Quality.LOST: (150, 150, 150),
}
#: Colors of lines in plots, distinct for color-blind people, too (Okabe & Ito 2008).
LINES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")
_TRACK_COLOR = (20, 20, 20)  # of markers as seen by cameras
_SHORTER_COLOR, _REST_COLOR, _LONGER_COLOR = (40, 90, 200), (225, 225, 225), (205, 35, 45)
_UNKNOWN_COLOR = (90, 90, 90)
_NARROW_COLOR, _WIDE_COLOR = (40, 150, 80), (215, 40, 60)  # of the intervals of markers

_CAMERA_OFFSET = np.array([0.45, -1.0, 0.55])  # from the body's center, in units of its diagonal
_MARKER_SIZE = 0.013  # of the body's diagonal
_TRACK_SIZE = 0.7  # of the size of markers
_DEFAULT_SIZE_MM = 100.0  # of devices without a surface
_TUBE_SIDES = 8


_LOOK_STEP, _LOOK_STEPS = 1e-4, 5  # of the distance from the camera; viser's tolerance is 1e-5
_looks = itertools.count()
_views: WeakKeyDictionary[Any, tuple[Float, float]] = WeakKeyDictionary()  # of each server


def place_camera(
    client: Any, position: Float, look_at: Float, up_direction: Float | None = None
) -> None:
    """Place the camera of one browser.

    Moving a viser camera also moves the point that it looks at. Viser does not send a point equal
    to the one that the browser reported last, even if a message that is on its way moves the point.
    So each call looks a little further along the same line than the last one.

    Args:
        client: The browser's viser client.
        position: Position of the camera (3,), mm.
        look_at: Point (3,) in the middle of the picture, mm.
        up_direction: Direction (3,) that points up in the picture; by default as before.
    """
    if up_direction is not None:
        client.camera.up_direction = tuple(up_direction)
    line = look_at - position
    step = _LOOK_STEP * (1 + np.linalg.norm(look_at) / np.linalg.norm(line))
    client.camera.position = tuple(position)
    # Last, because moving the camera changes it.
    client.camera.look_at = tuple(look_at + (1 + next(_looks) % _LOOK_STEPS) * step * line)


def look_at_body(server: Any, vertices: Float) -> None:
    """Point the cameras of all browsers, now and as they connect, at a whole body.

    This holds until it is called with another body. The z axis points up.

    Args:
        server: The viser server.
        vertices: Vertices of the body (v, 3), mm.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    is_first = server not in _views
    _views[server] = (low + high) / 2, float(np.linalg.norm(high - low))

    def place(client: Any) -> None:
        center, size = _views[server]
        place_camera(client, center + size * _CAMERA_OFFSET, center, np.array([0.0, 0.0, 1.0]))

    if is_first:  # callbacks cannot be removed
        server.on_client_connect(place)
    for client in server.get_clients().values():
        place(client)


def cord_color(signal: float, low: float, high: float) -> tuple[int, int, int]:
    """Return the color of a cord: blue if its resistance falls, red if it rises.

    Args:
        signal: Its signal (R - R0)/R0.
        low: Smallest signal in the training, for the full blue.
        high: Largest signal in the training, for the full red.
    """
    if not np.isfinite(signal):
        return _UNKNOWN_COLOR
    end, limit = (_LONGER_COLOR, high) if signal > 0 else (_SHORTER_COLOR, low)
    return _mix(_REST_COLOR, end, signal / limit if limit else 0.0)


def marker_colors(radius: Float, typical: float) -> Int:
    """Return colors (m, 3): green for typical intervals, red for three times as wide ones.

    Args:
        radius: Radius of the markers' 90 % intervals (m,), mm; NaN if unknown.
        typical: Typical radius, mm.
    """
    share = np.clip((np.nan_to_num(radius, nan=3 * typical) / max(typical, 1e-9) - 1) / 2, 0, 1)
    narrow, wide = np.array(_NARROW_COLOR), np.array(_WIDE_COLOR)
    return np.asarray(np.rint(narrow + share[:, None] * (wide - narrow)), dtype=np.uint8)


def _mix(a: tuple[int, ...], b: tuple[int, ...], share: float) -> tuple[int, int, int]:
    x = min(max(share, 0.0), 1.0)
    red, green, blue = (round(p + x * (q - p)) for p, q in zip(a, b, strict=True))
    return red, green, blue


class LiveScene:
    """The device in a viser server's scene.

    Args:
        server: The viser server.
        device: The device.
        name: Name of its node in the scene.
        look: Whether browsers look at the device when they connect.
    """

    def __init__(
        self, server: Any, device: ViewedDevice, name: str = "/device", *, look: bool = True
    ) -> None:
        self._device, self._mesh = device, None
        scene = server.scene
        self._root = scene.add_frame(name, show_axes=False)
        scene.set_up_direction("+z")
        size = _DEFAULT_SIZE_MM
        if device.vertices is not None and device.faces is not None:
            low, high = device.vertices.min(axis=0), device.vertices.max(axis=0)
            size = float(np.linalg.norm(high - low))
            self._mesh = scene.add_mesh_simple(
                f"{name}/surface",
                device.vertices.astype(np.float32),
                device.faces.astype(np.uint32),
                color=BODY_COLORS[Quality.TRUSTED],
                opacity=0.55,
                side="double",
            )
            scene.add_grid(
                f"{name}/ground",
                width=2 * size,
                height=2 * size,
                cell_size=10.0,
                section_size=50.0,
                position=(*((low + high) / 2)[:2], float(low[2] - 0.05 * size)),
            )
            if look:
                look_at_body(server, device.vertices)
        self._marker_size = _MARKER_SIZE * size
        self._cords = carried_cords(device)
        self._tubes = [
            scene.add_mesh_simple(
                f"{name}/{channel}",
                tube_vertices(rest, device.cord_radius).astype(np.float32),
                tube_faces(len(rest)).astype(np.uint32),
                color=_REST_COLOR,
            )
            for channel, (rest, _) in zip(device.channels, self._cords, strict=False)
        ]
        self._markers: Any = None
        self._tracks: Any = None
        self._name, self._scene = name, scene

    @property
    def visible(self) -> bool:
        """Whether the device is shown."""
        return bool(self._root.visible)

    @visible.setter
    def visible(self, is_visible: bool) -> None:
        self._root.visible = is_visible

    def close(self) -> None:
        """Remove the device from the scene."""
        self._root.remove()

    def show(self, frame: LiveFrame) -> None:
        """Show a frame."""
        device = self._device
        if self._mesh is not None and frame.vertices is not None and device.vertices is not None:
            self._mesh.vertices = frame.vertices.astype(np.float32)
            self._mesh.color = BODY_COLORS[frame.quality]
            displacements = frame.vertices - device.vertices
            for k, (tube, (rest, weights)) in enumerate(zip(self._tubes, self._cords, strict=True)):
                path = rest + weights @ displacements
                tube.vertices = tube_vertices(path, device.cord_radius).astype(np.float32)
                signal, low, high = frame.signals[k], device.low[k], device.high[k]
                tube.color = cord_color(float(signal), float(low), float(high))
        colors = marker_colors(frame.radius, device.radius)
        points = frame.markers.astype(np.float32)
        if self._markers is None:
            self._markers = self._scene.add_point_cloud(
                f"{self._name}/markers",
                points,
                colors,
                point_size=self._marker_size,
                point_shape="circle",
                precision="float32",
            )
        else:
            self._markers.points, self._markers.colors = points, colors
        if frame.tracks is not None:
            self._show_tracks(frame.tracks)

    def _show_tracks(self, tracks: Float) -> None:
        """Show in black where cameras see the markers."""
        points = tracks[np.isfinite(tracks).all(axis=1)].astype(np.float32)
        if self._tracks is None and len(points):
            self._tracks = self._scene.add_point_cloud(
                f"{self._name}/tracks",
                points,
                _TRACK_COLOR,
                point_size=_TRACK_SIZE * self._marker_size,
                point_shape="diamond",
                precision="float32",
            )
        elif self._tracks is not None:
            self._tracks.points = points


def tube_faces(count: int) -> Int:
    """Return the triangles (f, 3) of a tube along a path of `count` points, open at its ends."""
    ring = np.arange(_TUBE_SIDES)
    along = _TUBE_SIDES * np.arange(count - 1)[:, None]
    a, b = along + ring, along + (ring + 1) % _TUBE_SIDES
    quads = np.stack([a, b, b + _TUBE_SIDES, a, b + _TUBE_SIDES, a + _TUBE_SIDES], axis=-1)
    return np.asarray(quads.reshape(-1, 3), np.int64)


def tube_vertices(path: Float, radius: float) -> Float:
    """Return the vertices (8 p, 3), mm, of a tube of a radius (mm) around a path (p, 3), mm."""
    along = np.gradient(path, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    # A direction that no part of the path follows keeps neighboring rings aligned.
    spread = np.linalg.eigh(along.T @ along)[1][:, 0]
    x = np.cross(along, np.where(np.abs(along @ spread)[:, None] < 0.99, spread, spread[::-1]))
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    y = np.cross(along, x)
    angle = 2 * np.pi * np.arange(_TUBE_SIDES) / _TUBE_SIDES
    ring = np.cos(angle)[:, None] * x[:, None] + np.sin(angle)[:, None] * y[:, None]
    return np.asarray((path[:, None] + radius * ring).reshape(-1, 3))
