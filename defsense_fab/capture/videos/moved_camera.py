"""One camera of three or more that was moved since all were arranged, or is not in step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from ..tracking.observations import ObservationSource, frame_blocks
from ..tracking.reconstruction import reconstruct
from .camera_sync import together, views_of
from .located_tags import Count

_SOME = 300  # tags that are looked at
_FEW = 20  # that tell nothing
_WELL, _FITS = 0.1, 0.25  # px, that raise no doubt, and by which the others may fit together
_AGREE = 0.9  # of the tags, on which they agree
_WORSE = 3.0  # times as far, that is


def moved_camera(
    cameras: Sequence[Camera], views: Iterable[tuple[Float, Float] | None], size: float
) -> int | None:
    """The one without which the others fit together, where they do so without no other; None where
    all fit, or it cannot be told which. `views`: corners (n, v, 4, 2) px without distortion and
    their covariance (n, v, 5, 2, 2) of `some_tags`, once as the cameras' clocks were brought in
    step, where all may fit, and once as they were: views of a camera that was moved can look
    late."""
    taken = []
    for some in views:
        if some is None or _miss(cameras, *some, size) <= _WELL:
            return None
        taken.append(some)
    found = (_odd_one(cameras, *some, size) for some in reversed(taken))
    return next((k for k in found if k is not None), None)


def some_tags(seen: Sequence[ObservationSource], count: Count) -> tuple[Float, Float] | None:
    """Corners and covariances of some tags that three of v cameras see, by the `count` (t, m) of
    those that do in the first one's frames; None where they are few."""
    rows = np.argwhere(count >= 3)
    if len(rows) < _FEW:
        return None
    return views_of(seen, rows[:: max(len(rows) // _SOME, 1)])


def cameras_that_see(seen: Sequence[ObservationSource]) -> Count:
    """How many cameras see a tag in each frame of the first one (t, m)."""
    count = np.zeros((len(seen[0].time), len(seen[0].ids)), np.int8)
    for frames in frame_blocks(*count.shape):
        corners, _ = together(seen, frames)
        count[frames] = np.isfinite(corners).all(axis=(3, 4)).sum(axis=2)
    return count


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
