"""Points inside a body, carried along by its surface."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ...core.arrays import Float, Int

# A cord as a tube around its path.

_SIDES = 8


def tube_faces(count: int) -> Int:
    """(f, 3) of a tube along a path of `count` points, open at its ends."""
    ring = np.arange(_SIDES)
    along = _SIDES * np.arange(count - 1)[:, None]
    a, b = along + ring, along + (ring + 1) % _SIDES
    quads = np.stack([a, b, b + _SIDES, a, b + _SIDES, a + _SIDES], axis=-1)
    return np.asarray(quads.reshape(-1, 3), np.int64)


def tube_vertices(path: Float, radius: float) -> Float:
    """(8 p, 3) mm around a path (p, 3) mm."""
    along = np.gradient(path, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    # One direction that no part of the path runs along keeps neighbouring rings in step.
    spread = np.linalg.eigh(along.T @ along)[1][:, 0]
    x = np.cross(along, np.where(np.abs(along @ spread)[:, None] < 0.99, spread, spread[::-1]))
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    y = np.cross(along, x)
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.cos(angle)[:, None] * x[:, None] + np.sin(angle)[:, None] * y[:, None]
    return np.asarray((path[:, None] + radius * ring).reshape(-1, 3))


_NEIGHBOURS = 400  # so many lie on all sides of a point, not on the nearest face alone


def carrying_weights(points: Float, vertices: Float) -> sparse.csr_matrix:
    """(p, v): displacements of the points (p, 3) are these times displacements of the vertices
    (v, 3), all mm. Moving least squares with linear functions (Lancaster & Salkauskas 1981): exact
    where the body moves affinely, so rigidly."""
    count = min(_NEIGHBOURS, len(vertices))
    distance, near = cKDTree(vertices).query(points, k=count)
    theta = 1 / np.maximum(distance, 1e-3) ** 4
    P = np.concatenate(
        [np.ones((*near.shape, 1)), vertices[near] - points[:, None]], axis=2
    )  # (p, k, 4)
    moments = np.einsum("pki,pk,pkj->pij", P, theta, P)
    scale = np.trace(moments, axis1=1, axis2=2)[:, None, None]
    first = np.linalg.solve(moments + 1e-9 * scale * np.eye(4), np.eye(4)[:, :1])[..., 0]
    weights = np.einsum("pki,pi,pk->pk", P, first, theta)
    weights /= weights.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(points)), count)
    shape = (len(points), len(vertices))
    return sparse.csr_matrix((weights.ravel(), (rows, near.ravel())), shape=shape)
