"""The derivative of the signal array by array: what the fused loops are tested against."""

from __future__ import annotations

import numpy as np

from defsense_fab.core.arrays import Float


def signal_gradient(
    rest: Float, deformed: Float, deformation_gradient: Float, gauge_factor: float
) -> tuple[Float, Float]:
    """Signal of one cord and its derivative by the rest positions of the path.

    `rest` (p, 3), `deformed` (s, p, 3), `deformation_gradient` F (s, p, 3, 3), F[a, j] =
    dx'_a / dX_j. Returns (s,) and (s, p, 3). Exact for the polyline wherever u is smooth.
    """
    step, moved = np.diff(rest, axis=0), np.diff(deformed, axis=1)
    length = np.linalg.norm(step, axis=1)
    stretched = np.linalg.norm(moved, axis=2)
    total, total_moved = length.sum(), stretched.sum(1)
    unit, unit_moved = step / length[:, None], moved / stretched[..., None]
    by_rest, by_moved = np.zeros_like(rest), np.zeros_like(deformed)
    by_rest[1:] += unit
    by_rest[:-1] -= unit
    by_moved[:, 1:] += unit_moved
    by_moved[:, :-1] -= unit_moved
    pulled = np.einsum("spa,spaj->spj", by_moved, deformation_gradient)
    ratio = total_moved / total
    gradient = gauge_factor / total * (pulled - ratio[:, None, None] * by_rest)
    return np.asarray(gauge_factor * (ratio - 1)), gradient
