"""The camera of a browser: its initial view of a body, and picking in its picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ...core.arrays import Bool, Float, Int

_CAMERA_OFFSET = np.array([0.45, -1.0, 0.55])  # from the body's center, in units of its diagonal

_views: WeakKeyDictionary[Any, tuple[Float, float]] = WeakKeyDictionary()  # of each server


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
        client.camera.up_direction = (0.0, 0.0, 1.0)
        client.camera.position = tuple(center + size * _CAMERA_OFFSET)
        client.camera.look_at = tuple(center)  # last, because moving the camera changes it

    if is_first:  # callbacks cannot be removed
        server.on_client_connect(place)
    for client in server.get_clients().values():
        place(client)


@dataclass(frozen=True)
class View:
    """The camera of a browser.

    Attributes:
        position: Its position (3,), mm.
        axes: Its axes (3, 3) as columns: right, down, ahead.
        angle: Its vertical angle of view, rad.
        aspect: Width of the picture over its height.
    """

    position: Float
    axes: Float
    angle: float
    aspect: float

    @classmethod
    def of(cls, camera: Any) -> View:
        """Return the view of a viser client's camera."""
        from scipy.spatial.transform import Rotation

        w, x, y, z = np.asarray(camera.wxyz, float)
        axes = Rotation.from_quat([x, y, z, w]).as_matrix()
        return cls(
            np.asarray(camera.position, float), axes, float(camera.fov), float(camera.aspect)
        )


def in_rectangle(points: Float, view: View, low: Float, high: Float) -> Bool:
    """Return which points (n,) appear in a rectangle of the picture, hidden ones included.

    Args:
        points: Points (n, 3), mm.
        view: The camera.
        low: Upper left corner of the rectangle (2,), from 0 to 1 of the picture.
        high: Its lower right corner (2,).
    """
    in_view = (points - view.position) @ view.axes
    is_ahead = in_view[:, 2] > 0
    half = np.tan(view.angle / 2) * np.where(is_ahead, in_view[:, 2], 1.0)
    across = (in_view[:, 0] / (half * view.aspect) + 1) / 2
    down = (in_view[:, 1] / half + 1) / 2
    position = np.stack([across, down], axis=1)
    return np.asarray(is_ahead & ((position >= low) & (position <= high)).all(axis=1))


def intersect_ray(
    vertices: Float, faces: Int, origin: Float, direction: Float
) -> tuple[int, Float] | None:
    """Return the first triangle that a ray hits, and where, as weights (3,) of its corners.

    Args:
        vertices: Vertices (v, 3), mm.
        faces: Triangles (f, 3).
        origin: Start of the ray (3,), mm.
        direction: Its direction (3,).

    Returns:
        None if it hits no triangle.

    References:
        Moeller, Trumbore: Fast, minimum storage ray/triangle intersection, 1997.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    p = np.cross(direction, c - a)
    det = np.einsum("ij,ij->i", b - a, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = origin - a
        u = np.einsum("ij,ij->i", t, p) / det
        q = np.cross(t, b - a)
        v = q @ direction / det
        distance = np.einsum("ij,ij->i", c - a, q) / det
        is_hit = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    if not is_hit.any():
        return None
    k = int(np.flatnonzero(is_hit)[np.argmin(distance[is_hit])])
    return k, np.array([1 - u[k] - v[k], u[k], v[k]])
