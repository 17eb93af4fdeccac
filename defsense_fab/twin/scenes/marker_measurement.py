"""What cameras make of markers' places: noise that is known, gaps, and places that are wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from .assumptions import assume

_CERTAIN = 1e-3  # mm, stated where there is no noise


@dataclass(frozen=True)
class MarkerTraits:
    """Two cameras that look along the body's shortest side."""

    rate: float = assume(30.0, "cameras", "Hz", "pictures", off=30.0)
    in_plane: float = assume(0.08, "marker-noise", "mm", "standard deviation across the view")
    depth: float = assume(0.2, "marker-noise", "mm", "along the view; both are stated")
    hidden: float = assume(0.05, "gaps", "1", "share of the time that a marker is not seen")
    gap: float = assume(0.7, "gaps", "s", "mean length of a gap, exponential", off=0.7)
    wrong: float = assume(0.0, "wrong-markers", "1", "share of places that are wrong, unstated")
    wrong_by: float = assume(5.0, "wrong-markers", "mm", "by so much, along each axis", off=5.0)


def measure_markers(
    time: Float, points: Float, depth_axis: int, traits: MarkerTraits, rng: np.random.Generator
) -> tuple[Float, Float]:
    """Places and standard deviations (t, m, 3) mm, NaN where a marker is not seen, of `points`
    (t, m, 3) mm at times (t,) s."""
    sigma = np.full(3, max(traits.in_plane, 0.0))
    sigma[depth_axis] = traits.depth
    out = points + sigma * rng.normal(size=points.shape)
    stated = np.broadcast_to(np.where(sigma > 0, sigma, _CERTAIN), points.shape).copy()
    wild = rng.random(points.shape[:2]) < traits.wrong
    out = out + np.where(wild[..., None], traits.wrong_by * rng.normal(size=points.shape), 0.0)
    hidden = _gaps(time, points.shape[1], traits, rng)
    out[hidden], stated[hidden] = np.nan, np.nan
    return out, stated


def _gaps(time: Float, count: int, traits: MarkerTraits, rng: np.random.Generator) -> Bool:
    """Which markers (t, m) are hidden: gaps begin at random, so often that they take up the
    share."""
    out = np.zeros((len(time), count), bool)
    length = float(time[-1] - time[0])
    if traits.hidden <= 0:
        return out
    often = traits.hidden / (1 - traits.hidden) / traits.gap
    for m in range(count):
        begins = np.sort(time[0] + length * rng.random(rng.poisson(often * length)))
        for begin, gap in zip(begins, rng.exponential(traits.gap, len(begins)), strict=True):
            out[(time >= begin) & (time < begin + gap), m] = True
    return out
