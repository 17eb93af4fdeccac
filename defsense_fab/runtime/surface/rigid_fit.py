"""Where a body of which nothing is fixed stands as a whole."""

from __future__ import annotations

from ...core.arrays import Float
from .rotation import nearest_rotations


def rigid_fit(points: Float, onto: Float, weights: Float) -> tuple[Float, Float]:
    """Rotation (3, 3) and shift (3,) mm with the least squares of `points` (m, 3) moved `onto`
    (m, 3), by weights (m,) (W. Kabsch, Acta Cryst. A 32 (1976))."""
    w = weights / weights.sum()
    a, b = w @ points, w @ onto
    rotation = nearest_rotations(((onto - b).T @ ((points - a) * w[:, None]))[None])[0]
    return rotation, b - rotation @ a
