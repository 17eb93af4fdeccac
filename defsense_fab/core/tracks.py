"""Where markers were, by time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Bool, Float, Int
from .errors import CaptureError


@dataclass(frozen=True)
class Tracks:
    """t frames of m markers: `time` (t,) s, increasing; the markers' numbers `ids` (m,); `points`
    (t, m, 3) mm, NaN where a marker was not seen; `sigma` (t, m, 3) mm, standard deviations along
    the axes, NaN likewise (all NaN where they are not known); `frame` (t,), numbers of the frames,
    which may leave some out."""

    time: Float
    ids: Int
    points: Float
    sigma: Float
    frame: Int

    def __post_init__(self) -> None:
        t, m = len(self.time), len(self.ids)
        shapes = (self.time.shape, self.frame.shape, self.points.shape, self.sigma.shape)
        if shapes != ((t,), (t,), (t, m, 3), (t, m, 3)):
            raise CaptureError(
                f"tracks of {t} frames and {m} markers cannot have points {self.points.shape},"
                f" sigma {self.sigma.shape} and frames {self.frame.shape}",
                code="wrong-shape",
            )
        if (np.diff(self.time) <= 0).any() or not np.isfinite(self.time).all():
            raise CaptureError(
                "tracks: times must increase from frame to frame", code="times-not-increasing"
            )
        if len(np.unique(self.ids)) < m:
            raise CaptureError("tracks: two markers of one number", code="duplicate-marker")
        if (np.isnan(self.points).any(-1) != np.isnan(self.points).all(-1)).any():
            raise CaptureError(
                "tracks: of a marker a part of its place is NaN; write three numbers or three NaN",
                code="point-partly-nan",
            )

    def part(self, frames: slice | Bool) -> Tracks:
        """Some of the frames, a mask (t,) or a slice."""
        return Tracks(
            self.time[frames], self.ids, self.points[frames], self.sigma[frames], self.frame[frames]
        )

    @property
    def seen(self) -> Bool:
        """Which markers were seen (t, m)."""
        return np.asarray(np.isfinite(self.points[..., 0]))
