"""Rotations by vectors along the axis, as long as the angle in rad."""

from __future__ import annotations

import numpy as np

from ..arrays import Float


def cross_matrices(a: Float) -> Float:
    """Matrices (..., 3, 3) of the cross product with a (..., 3)."""
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    return out - np.swapaxes(out, -1, -2)


def rotations(r: Float) -> Float:
    """Rotations (..., 3, 3) by vectors (..., 3) rad (Rodrigues)."""
    angle = np.linalg.norm(r, axis=-1)[..., None, None]
    K = cross_matrices(r)
    s = np.sinc(angle / np.pi)
    c = np.sinc(angle / (2 * np.pi)) ** 2 / 2
    return np.asarray(np.eye(3) + s * K + c * K @ K)
