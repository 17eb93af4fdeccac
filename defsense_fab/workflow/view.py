"""Pages in the browser: open one, draw bodies and cords on it, and pick points in its picture."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Bool, Float, Int
from ..core.machine.local_access import Access
from ..runtime.view import live_messages as live_messages
from ..runtime.view.guided_screen import GuidedScreen as GuidedScreen
from ..runtime.view.guided_stream import WebGuidedScreen as WebGuidedScreen
from ..runtime.view.live_page import GuidedPage as GuidedPage
from ..runtime.view.live_page import WebLiveView as WebLiveView
from ..runtime.view.live_page import open_guided_page as open_guided_page
from ..runtime.view.live_place import LivePlace as LivePlace
from ..runtime.view.live_scene import LINES as LINES
from ..runtime.view.live_scene import look_at_body as look_at_body
from ..runtime.view.live_scene import place_camera as place_camera
from ..runtime.view.live_scene import tube_faces as tube_faces
from ..runtime.view.live_scene import tube_vertices as tube_vertices
from ..runtime.view.live_view import LiveView as LiveView
from ..runtime.view.live_view import PagePlace as PagePlace
from ..runtime.view.messages import Arrays as Arrays
from ..runtime.view.messages import Event as Event
from ..runtime.view.messages import Problem as Problem
from ..runtime.view.messages import Record as Record
from ..runtime.view.messages import Reply as Reply
from ..runtime.view.messages import Request as Request
from ..runtime.view.messages import Result as Result
from ..runtime.view.messages import Upload as Upload
from ..runtime.view.page_server import HOST as HOST
from ..runtime.view.page_server import close_page, serve_page
from ..runtime.view.surface_arrays import feature_edges as feature_edges
from ..runtime.view.surface_arrays import surface_arrays as surface_arrays
from ..runtime.view.web_server import Client as Client
from ..runtime.view.web_server import Download as Download
from ..runtime.view.web_server import WebServer as WebServer

_EDGE_TOLERANCE = 1e-9  # of barycentric coordinates, so that rays hit shared edges


@dataclass(frozen=True)
class OpenPage:
    """A page that is served.

    Attributes:
        server: The viser server.
        url: Link to open in a browser.
        has_token: Whether the link contains a token, with which other machines have access.
    """

    server: Any
    url: str
    has_token: bool


@contextlib.contextmanager
def open_page(port: int, title: str, host: str | None = None) -> Iterator[OpenPage]:
    """Serve a page until the block ends.

    Args:
        port: The port.
        title: Title of the page.
        host: Address of this machine to serve others at, or 0.0.0.0 for all; None to serve this
            machine alone.

    Raises:
        OutputError: The port is in use, the host is not an address of this machine, or viser is not
            installed.
    """
    address = host or HOST
    access = Access(address)
    server = serve_page(port, title, access, address)
    try:
        yield OpenPage(server, access.link(port), bool(access.token))
    finally:
        close_page(server)


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
        axes = rotation_matrix(camera.wxyz)
        return cls(
            np.asarray(camera.position, float), axes, float(camera.fov), float(camera.aspect)
        )


def quaternion(axes: Float) -> tuple[float, float, float, float]:
    """Return the quaternion w, x, y, z of a rotation matrix (3, 3), as viser takes it."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(axes).as_quat().tolist()
    return w, x, y, z


def rotation_matrix(wxyz: Sequence[float] | Float) -> Float:
    """Return the rotation matrix (3, 3) of a quaternion w, x, y, z of viser."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = wxyz
    return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix())


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
        is_hit = (det != 0) & (distance > 0)
        is_hit &= (u >= -_EDGE_TOLERANCE) & (v >= -_EDGE_TOLERANCE)
        is_hit &= u + v <= 1 + _EDGE_TOLERANCE
    if not is_hit.any():
        return None
    k = int(np.flatnonzero(is_hit)[np.argmin(distance[is_hit])])
    return k, np.array([1 - u[k] - v[k], u[k], v[k]])
