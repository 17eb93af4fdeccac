"""What libigl computes of a triangle surface: Laplacian, areas, nearest points, fewer triangles."""

from __future__ import annotations

import igl
import numpy as np
from scipy.sparse import csr_array

from ...core.arrays import Float, Int

_STEEPEST = 1e3  # cotangents beyond are those of triangles without area


def laplacian(vertices: Float, triangles: Int) -> csr_array:
    """The cotangent Laplacian (v, v), positive semidefinite, without unit."""
    matrix = csr_array(-igl.cotmatrix(vertices, triangles.astype(np.int64)))
    matrix.sum_duplicates()
    off = matrix.tocoo()
    apart = off.row != off.col
    weights = np.clip(np.nan_to_num(-off.data[apart], nan=0.0), -_STEEPEST, _STEEPEST)
    weights[weights == 0.0] = 1e-12  # right-angled grids: an edge stays a neighbour
    between = csr_array((weights, (off.row[apart], off.col[apart])), shape=matrix.shape)
    diagonal = csr_array((between.sum(axis=1), (np.arange(len(vertices)),) * 2), shape=matrix.shape)
    out = csr_array(diagonal - between)
    out.sort_indices()
    return out


def vertex_areas(vertices: Float, triangles: Int) -> Float:
    """A third of the triangles around each, (v,) mm^2."""
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 6
    return np.asarray(np.bincount(triangles.ravel(), np.repeat(area, 3), len(vertices)), float)


def nearest_points(points: Float, vertices: Float, triangles: Int) -> tuple[Int, Float]:
    """The triangle's vertices (p, 3) and weights (p, 3) of the nearest point to each (p, 3)."""
    triangles = np.ascontiguousarray(triangles, np.int64)
    _, face, at = igl.point_mesh_squared_distance(
        np.ascontiguousarray(points), np.ascontiguousarray(vertices), triangles
    )[:3]
    face = np.asarray(face).ravel()
    a, b, c = (np.ascontiguousarray(vertices[triangles[face, k]]) for k in range(3))
    weights = _barycentric(np.asarray(at), a, b, c)
    return triangles[face], weights


def _barycentric(at: Float, a: Float, b: Float, c: Float) -> Float:
    u, v, w = b - a, c - a, at - a
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    wu, wv = (w * u).sum(1), (w * v).sum(1)
    whole = np.maximum(uu * vv - uv * uv, 1e-300)
    second, third = (vv * wu - uv * wv) / whole, (uu * wv - uv * wu) / whole
    weights = np.clip(np.stack([1 - second - third, second, third], axis=1), 0.0, 1.0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def decimated(vertices: Float, triangles: Int, count: int) -> tuple[Float, Int]:
    """About `count` vertices, by collapsing the shortest edges to their middles: even meshes."""
    coarse, faces = igl.decimate(
        np.asfortranarray(vertices), np.asfortranarray(triangles, np.int32), 2 * count
    )[:2]
    used, faces = np.unique(np.asarray(faces), return_inverse=True)
    return np.ascontiguousarray(np.asarray(coarse)[used]), faces.reshape(-1, 3).astype(np.int64)
