"""Points inside a body, carried along by its surface."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ...core.arrays import Float

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
