"""Points of a body's skin with their normals."""

from __future__ import annotations

import igl
import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface

_WITHIN = 20


def samples(body: Surface, size: float) -> tuple[Float, Float]:
    """Points (n, 3) mm spread over the skin, about 20 within a square of `size` mm unless
    the body is large, and its unit normals there (n, 3)."""
    a, b, c = (body.vertices[body.faces[:, i]] for i in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    count = int(np.clip(_WITHIN * area / size**2, 1000, 30_000))
    points = body.scatter(count, np.random.default_rng(1))
    _, face, _ = igl.point_mesh_squared_distance(points, body.vertices, body.faces)
    a, b, c = (body.vertices[body.faces[np.asarray(face)][:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    return points, normal / np.linalg.norm(normal, axis=1, keepdims=True)
