"""What of a body lies in a rectangle of the picture, or under the mouse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ...core.arrays import Bool, Float, Int

# Where a browser looks from when it comes.

_FROM = np.array([0.45, -1.0, 0.55])  # times the body's diagonal, from its middle


_places: WeakKeyDictionary[Any, tuple[Float, float]] = WeakKeyDictionary()  # of each server


def look_at_body(server: Any, vertices: Float) -> None:
    """At a body's `vertices` (v, 3) mm as a whole, z being up; in each browser, now and as it
    connects, until another body is looked at."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    first = server not in _places
    _places[server] = (low + high) / 2, float(np.linalg.norm(high - low))

    def place(client: Any) -> None:
        middle, size = _places[server]
        client.camera.up_direction = (0.0, 0.0, 1.0)
        client.camera.position = tuple(middle + size * _FROM)
        client.camera.look_at = tuple(middle)  # last: moving the camera moves it too

    if first:  # it cannot be taken back
        server.on_client_connect(place)
    for client in server.get_clients().values():
        place(client)


@dataclass(frozen=True)
class View:
    """A browser's camera: where it stands (3,) mm, its axes (3, 3) as columns (right, down, ahead),
    its vertical angle of view, rad, and how much wider than high the picture is."""

    position: Float
    axes: Float
    angle: float
    aspect: float

    @classmethod
    def of(cls, camera: Any) -> View:
        """That of a viser client."""
        from scipy.spatial.transform import Rotation

        w, x, y, z = np.asarray(camera.wxyz, float)
        axes = Rotation.from_quat([x, y, z, w]).as_matrix()
        return cls(
            np.asarray(camera.position, float), axes, float(camera.fov), float(camera.aspect)
        )


def in_rectangle(points: Float, view: View, low: Float, high: Float) -> Bool:
    """Which points (n, 3) mm appear in the rectangle from `low` to `high`, each (2,) from 0 to 1,
    from the upper left corner of the picture; those behind others, too."""
    seen = (points - view.position) @ view.axes
    ahead = seen[:, 2] > 0
    half = np.tan(view.angle / 2) * np.where(ahead, seen[:, 2], 1.0)
    across = (seen[:, 0] / (half * view.aspect) + 1) / 2
    down = (seen[:, 1] / half + 1) / 2
    place = np.stack([across, down], axis=1)
    return np.asarray(ahead & ((place >= low) & (place <= high)).all(axis=1))


def hit(vertices: Float, faces: Int, origin: Float, direction: Float) -> tuple[int, Float] | None:
    """The first triangle of (m, 3) that a ray meets, and where, as weights (3,) of its corners;
    None where it meets none (Moeller & Trumbore 1997)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    p = np.cross(direction, c - a)
    det = np.einsum("ij,ij->i", b - a, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = origin - a
        u = np.einsum("ij,ij->i", t, p) / det
        q = np.cross(t, b - a)
        v = q @ direction / det
        far = np.einsum("ij,ij->i", c - a, q) / det
        met = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0)
    if not met.any():
        return None
    k = int(np.flatnonzero(met)[np.argmin(far[met])])
    return k, np.array([1 - u[k] - v[k], u[k], v[k]])
