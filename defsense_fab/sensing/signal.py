"""The cord's signal: relative change of resistance, measured or along a deformed polyline.

A segment's strain is eps = |x'_{k+1} - x'_k| / |x_{k+1} - x_k| - 1 with x' = x + u(x), and the
signal of a cord that follows it is the mean over the rest length of the response w(eps).
(DefSense, CHI 2016, Eqs. 1-3, with the length of the deformed polyline in place of F at the
midpoints.)
"""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float
from .response import Response


def signals(rest: Float, deformed: Float, response: Response) -> Float:
    """(R - R0)/R0 of cords in states.

    `rest` (..., p, 3) mm; `deformed` (s, ..., p, 3) mm. Returns (s, ...).
    """
    before, after = (np.linalg.norm(np.diff(x, axis=-2), axis=-1) for x in (rest, deformed))
    length = before.sum(-1)
    slope = response.slope_everywhere
    if slope is not None:  # the length alone counts
        return np.asarray(slope * (after.sum(-1) / length - 1))
    before = np.maximum(before, 1e-300)  # a segment without length answers to nothing
    return np.asarray((before * response(after / before - 1)).sum(-1) / length)


def relative_change(resistance: Float, rest: Float) -> Float:
    """(R - R0)/R0, without unit.

    `resistance` (..., c) ohm as measured; `rest` ohm at rest, of a shape that broadcasts to it.
    Returns (..., c): NaN where either is, inf for an open circuit.
    """
    return np.asarray(resistance / rest - 1)


def mean_strain(rest: Float, deformed: Float) -> Float:
    """Relative change of length (s, ...) of polylines: `rest` (..., p, 3) mm, `deformed`
    (s, ..., p, 3) mm."""
    before, after = (np.linalg.norm(np.diff(x, axis=-2), axis=-1) for x in (rest, deformed))
    return np.asarray(after.sum(-1) / before.sum(-1) - 1)


def strain_range(rest: Float, deformed: Float) -> tuple[float, float]:
    """Least and greatest strain of any segment in any state: rest (p, 3), deformed (s, p, 3)."""
    length = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    strain = np.linalg.norm(np.diff(deformed, axis=1), axis=2) / length - 1
    return float(strain.min()), float(strain.max())
