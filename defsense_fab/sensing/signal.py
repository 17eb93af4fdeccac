"""The cord's signal: relative change of resistance along a deformed polyline.

METHOD: a segment's strain is eps = |x'_{k+1} - x'_k| / |x_{k+1} - x_k| - 1 with x' = x + u(x),
and the signal is the mean over the rest length of the response w(eps) = gauge_factor * eps.
(DefSense, CHI 2016, Eqs. 1-3, with the length of the deformed polyline in place of F at the
midpoints.)
"""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float


def signals(rest: Float, deformed: Float, gauge_factor: float) -> Float:
    """(R - R0)/R0 of cords in states.

    `rest` (..., p, 3) mm; `deformed` (s, ..., p, 3) mm. Returns (s, ...).
    """
    length = np.linalg.norm(np.diff(rest, axis=-2), axis=-1).sum(-1)
    stretched = np.linalg.norm(np.diff(deformed, axis=-2), axis=-1).sum(-1)
    return np.asarray(gauge_factor * (stretched / length - 1))


def peak_strain(rest: Float, deformed: Float) -> float:
    """Largest strain of any segment in any state: rest (p, 3), deformed (s, p, 3)."""
    length = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    return float((np.linalg.norm(np.diff(deformed, axis=1), axis=2) / length - 1).max())
