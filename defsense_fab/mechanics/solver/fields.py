"""What can be read from a solved displacement: gradients, stretches, at nodes and anywhere."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ..elements.tet10 import QuadraticMesh
from .field_validity import nodal_gradients


def deformation_gradient_at_nodes(mesh: QuadraticMesh, u: Float) -> Float:
    """F (n, 3, 3) at the nodes, averaged over the tets that share each by their volume."""
    F = nodal_gradients(mesh, u)
    weight = np.repeat(mesh.weight[:, None], 10, axis=1).ravel()
    nodes, count = mesh.cells.ravel(), len(mesh.nodes)
    share = np.bincount(nodes, weight, count)
    flat = F.reshape(-1, 9)
    total = np.stack([np.bincount(nodes, weight * flat[:, k], count) for k in range(9)], axis=1)
    return np.asarray((total / share[:, None]).reshape(-1, 3, 3))


def principal_stretches(F: Float) -> Float:
    """Stretches (..., 3) of gradients (..., 3, 3), largest first: the singular values."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(_right_cauchy_green(F)), 0))[..., ::-1])


def stretch_along(F: Float, direction: Float) -> Float:
    """|F d| (...) of gradients (..., 3, 3) along rest directions (..., 3), of any length."""
    d = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.asarray(np.linalg.norm(np.einsum("...aj,...j->...a", F, d), axis=-1))


def green_strain(F: Float) -> Float:
    """E = (F^T F - 1) / 2, (..., 3, 3)."""
    return np.asarray((_right_cauchy_green(F) - np.eye(3)) / 2)


def _right_cauchy_green(F: Float) -> Float:
    return np.asarray(np.einsum("...ki,...kj->...ij", F, F))
