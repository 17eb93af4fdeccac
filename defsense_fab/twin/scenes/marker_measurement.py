"""Simulated measurements of marker positions by cameras: known noise, gaps and outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from .assumptions import assume

MIN_STATED_SIGMA_MM = 1e-3  # reported where the measurement has no noise


@dataclass(frozen=True)
class MarkerTraits:
    """Assumptions on two cameras that look along the shortest side of the body.

    Attributes:
        rate: Frame rate, Hz.
        in_plane: Standard deviation of a position across the view, mm.
        depth: Standard deviation along the view, mm.
        hidden: Share of the time in which a marker is not visible.
        gap: Mean length of a gap, s.
        wrong: Share of positions that are outliers.
        wrong_by: Standard deviation of the error of outliers along each axis, mm.
    """

    rate: float = assume(30.0, "cameras", "Hz", "frame rate", off=30.0)
    in_plane: float = assume(
        0.08, "marker-noise", "mm", "standard deviation across the view, reported to the decoder"
    )
    depth: float = assume(
        0.2, "marker-noise", "mm", "standard deviation along the view, reported to the decoder"
    )
    hidden: float = assume(0.05, "gaps", "1", "share of the time in which a marker is hidden")
    gap: float = assume(0.7, "gaps", "s", "mean length of a gap, exponential", off=0.7)
    wrong: float = assume(0.0, "wrong-markers", "1", "share of outliers, not reported")
    wrong_by: float = assume(
        5.0, "wrong-markers", "mm", "standard deviation of outliers along each axis", off=5.0
    )


def measure_markers(
    time: Float, points: Float, depth_axis: int, traits: MarkerTraits, rng: np.random.Generator
) -> tuple[Float, Float]:
    """Simulate measurements of marker positions.

    Args:
        time: Times of the frames (t,) s.
        points: True positions (t, m, 3) mm in the device frame.
        depth_axis: The axis along which the cameras look, 0 to 2.
        traits: Noise, gaps and outliers.
        rng: Random generator.

    Returns:
        Measured positions and reported standard deviations, both (t, m, 3) mm; NaN where a marker
        is hidden.
    """
    sigma = np.full(3, max(traits.in_plane, 0.0))
    sigma[depth_axis] = traits.depth
    positions = points + sigma * rng.normal(size=points.shape)
    reported = np.broadcast_to(np.where(sigma > 0, sigma, MIN_STATED_SIGMA_MM), points.shape).copy()
    is_outlier = rng.random(points.shape[:2]) < traits.wrong
    outliers = traits.wrong_by * rng.normal(size=points.shape)
    positions = positions + np.where(is_outlier[..., None], outliers, 0.0)
    is_hidden = _draw_gaps(time, points.shape[1], traits, rng)
    positions[is_hidden], reported[is_hidden] = np.nan, np.nan
    return positions, reported


def _draw_gaps(time: Float, count: int, traits: MarkerTraits, rng: np.random.Generator) -> Bool:
    """Draw which markers (t, m) are hidden.

    Gaps start at random, at the rate that makes them cover the share `traits.hidden`.
    """
    is_hidden = np.zeros((len(time), count), bool)
    duration = float(time[-1] - time[0])
    if traits.hidden <= 0:
        return is_hidden
    gaps_per_s = traits.hidden / (1 - traits.hidden) / traits.gap
    for m in range(count):
        starts = np.sort(time[0] + duration * rng.random(rng.poisson(gaps_per_s * duration)))
        for start, length in zip(starts, rng.exponential(traits.gap, len(starts)), strict=True):
            is_hidden[(time >= start) & (time < start + length), m] = True
    return is_hidden
