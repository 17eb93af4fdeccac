"""One camera of three or more that was moved since all were arranged, or is not in step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ...capture.tracking.reconstruction import reconstruct
from ...core.arrays import Float
from ...core.camera import Camera

_SOME = 300  # tags that are looked at
_FEW = 20  # that tell nothing
_WELL, _FITS = 0.1, 0.25  # px, that raise no doubt, and by which the others may fit together
_AGREE = 0.9  # of the tags, on which they agree
_WORSE = 3.0  # times as far, that is


def moved_camera(
    cameras: Sequence[Camera], views: Iterable[tuple[Float, Float]], size: float
) -> int | None:
    """The one without which the others fit together, where they do so without no other; None where
    all fit, or it cannot be told which. `views`: corners (n, m, v, 4, 2) px without distortion and
    their covariance (n, m, v, 4, 2, 2), once as the cameras' clocks were brought in step, where all
    may fit, and once as they were: views of a camera that was moved can look late."""
    taken = []
    for corners, covariance in views:
        some = _some(corners, covariance)
        if some is None or _miss(cameras, *some, size) <= _WELL:
            return None
        taken.append(some)
    found = (_odd_one(cameras, *some, size) for some in reversed(taken))
    return next((k for k in found if k is not None), None)


def _some(corners: Float, covariance: Float) -> tuple[Float, Float] | None:
    """Tags (n, v, ...) that three cameras see; None where those are few."""
    there = np.isfinite(corners).all(axis=(3, 4))
    rows = np.argwhere(there.sum(axis=2) >= 3)
    if len(rows) < _FEW:
        return None
    rows = rows[:: max(len(rows) // _SOME, 1)]
    return corners[rows[:, 0], rows[:, 1]], covariance[rows[:, 0], rows[:, 1]]


def _odd_one(cameras: Sequence[Camera], seen: Float, spread: Float, size: float) -> int | None:
    miss = np.array(
        [
            _miss(
                [c for k, c in enumerate(cameras) if k != left],
                np.delete(seen, left, axis=1), np.delete(spread, left, axis=1), size,
            )
            for left in range(len(cameras))
        ]
    )  # fmt: skip
    best = int(miss.argmin())
    others = np.delete(miss, best)
    return best if miss[best] <= _FITS and (others > _WORSE * miss[best]).all() else None


def _miss(cameras: Sequence[Camera], seen: Float, spread: Float, size: float) -> float:
    """px, median by which views of a tag (n, v, 4, 2) miss each other; inf where they disagree."""
    found = reconstruct(cameras, seen[:, None], spread[:, None], size)
    several = found.seen >= 2
    if several.sum() < _FEW:
        return float("inf")
    if found.cameras[several].sum() < _AGREE * found.seen[several].sum():
        return float("inf")
    return float(np.nanmedian(found.miss[several]))
