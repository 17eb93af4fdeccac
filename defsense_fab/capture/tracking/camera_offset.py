"""By how much one camera's clock is behind another's, from moving tags alone.

Rays of two cameras to a moving tag meet only where both saw it at one time. The offset at which
they miss each other least is found on a grid, then between its points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Int
from ...core.camera import Camera
from .observations import Observed, at, middles
from .triangulation import triangulate

_MOST = 300  # tags looked at: those that move most
_LEAST = 30
_COARSE = 60  # of them, on the grid
_AGREE = 1.5  # px: views that miss by more, root mean square, are not of one time
_FINE = 1e-4  # s


@dataclass(frozen=True)
class Offset:
    """`value` s, to be added to the second camera's times; its standard deviation `sigma` s;
    residuals, px, `before` and `after`."""

    value: float
    sigma: float
    before: float
    after: float


def find_offset(
    cameras: Sequence[Camera], first: Observed, second: Observed, reach: float
) -> Offset | None:
    """Of two cameras whose clocks differ by at most `reach` s; None where too little moves, or the
    best is at the end of the reach."""
    period = float(np.median(np.diff(second.time))) if len(second.time) > 2 else 0.0
    rows = _moving(first, second)
    if rows is None or not 0 < period < reach:
        return None

    some, place = np.unique(rows[0], return_inverse=True)
    part = first.part(some)
    ours = part.corners[place, rows[1]], part.covariance[place, rows[1]]

    def miss(offset: float, every: int = 1) -> float:
        frames, tags = rows[0][::every], rows[1][::every]
        corners, covariance = at(second, first.time[frames], offset)
        n = np.arange(len(frames))
        both = np.stack([ours[0][::every], corners[n, tags]], axis=1)
        spread = np.stack([ours[1][::every], covariance[n, tags]], axis=1)
        there = np.isfinite(both).all(axis=(1, 2, 3))
        if there.sum() * every < _LEAST / 2:
            return float("inf")
        found = triangulate(cameras, both[there], spread[there])
        # Those that disagree count with what they may disagree at most.
        m = np.where(np.isfinite(found.miss), found.miss, 2.0)
        return float(np.mean(m**2))

    grid = np.arange(-reach, reach + period / 4, period / 2)
    coarse = max(len(rows[0]) // _COARSE, 1)
    values = np.array([miss(o, coarse) for o in grid])
    k = int(values.argmin())
    if not 0 < k < len(grid) - 1 or not np.isfinite(values[k - 1 : k + 2]).all():
        return None
    low, high = grid[k - 1], grid[k + 1]
    golden = (np.sqrt(5) - 1) / 2
    a, b = high - golden * (high - low), low + golden * (high - low)
    fa, fb = miss(a), miss(b)
    while high - low > _FINE:
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - golden * (high - low)
            fa = miss(a)
        else:
            low, a, fa = a, b, fb
            b = low + golden * (high - low)
            fb = miss(b)
    best = (low + high) / 2
    least, before = miss(best), miss(0.0)
    # Of a parabola through a step to both sides: how sharp the minimum is.
    h = period / 4
    bend = max((miss(best - h) + miss(best + h) - 2 * least) / h**2, 1e-12)
    sigma = float(np.sqrt(2 * least / bend / max(len(rows[0]) - 1, 1)))
    if least > _AGREE**2:
        return None  # nowhere in reach do they see the same
    return Offset(float(best), sigma, float(np.sqrt(before)), float(np.sqrt(least)))


def _moving(first: Observed, second: Observed) -> tuple[Int, Int] | None:
    """Frames of the first camera, and tags, that move most there and that the second sees too."""
    middle = middles(first)
    speed = np.full(middle.shape[:2], np.nan)
    if len(first.time) < 3:
        return None
    span = (first.time[2:] - first.time[:-2])[:, None]
    speed[1:-1] = np.linalg.norm(middle[2:] - middle[:-2], axis=2) / span
    speed[:, ~np.isfinite(middles(second)[..., 0]).any(axis=0)] = np.nan
    good = np.isfinite(speed)
    if good.sum() < _LEAST:
        return None
    order = np.argsort(np.where(good, speed, -1.0), axis=None)[::-1][: min(_MOST, good.sum())]
    frames, tags = np.unravel_index(np.sort(order), speed.shape)
    return frames, tags
