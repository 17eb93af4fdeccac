"""Rotation vectors and matrices."""

from __future__ import annotations

import numpy as np

from .arrays import Float


def cross_matrices(vectors: Float) -> Float:
    """Return the matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    out = np.zeros((*vectors.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = (
        -vectors[..., 2],
        vectors[..., 1],
        -vectors[..., 0],
    )
    return out - np.swapaxes(out, -1, -2)


def rotation_matrices(vectors: Float) -> Float:
    """Return the rotations (..., 3, 3) by rotation vectors (..., 3), rad.

    A rotation vector points along the axis and is as long as the angle (Rodrigues).
    """
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    K = cross_matrices(vectors)
    s = np.sinc(angle / np.pi)
    c = np.sinc(angle / (2 * np.pi)) ** 2 / 2
    return np.asarray(np.eye(3) + s * K + c * K @ K)
