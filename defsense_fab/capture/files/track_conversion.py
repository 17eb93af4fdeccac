"""Tracks on even frames: with the frames that a camera dropped, as frames without markers.

Formats of motion capture have one rate and every frame; so that tracks are the same in whichever
format they are, all of them get these frames, numbers and rate. Places are never interpolated.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import CaptureError
from ...core.markers import Tracks

# Names of markers in the files of motion-capture systems.


@dataclass(frozen=True)
class Labelled:
    """Tracks of m markers, and the `labels` (m) that the file has for them."""

    tracks: Tracks
    labels: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.labels) != len(self.tracks.ids):
            raise CaptureError(
                f"{len(self.tracks.ids)} markers cannot have {len(self.labels)} labels",
                code="labels-differ",
            )


def labels_of(ids: Int) -> list[str]:
    """The labels that tags (m,) get: `tag_7`."""
    return [f"tag_{number}" for number in ids.tolist()]


def numbers_of(labels: Sequence[str]) -> Int:
    """Numbers (m,) for labels: the digits at their ends where all have some and no two the same,
    else 0 to m - 1."""
    ends = [re.search(r"[0-9]{1,15}$", label) for label in labels]
    found = [int(end.group()) for end in ends if end]
    if len(set(found)) < len(labels):
        found = list(range(len(labels)))
    return np.array(found, np.int64)


# Tracks turned so that another of their axes points upwards, by quarter turns alone.

#: To axes with y upwards, from: a camera's (x right, y down, z ahead), y upwards, z upwards.
_TO_Y = {
    "camera": np.diag([1.0, -1.0, -1.0]),
    "y": np.eye(3),
    "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}
#: In words.
AXES = {
    "camera": "x right, y down, z ahead",
    "y": "x right, y up, z back",
    "z": "x right, y ahead, z up",
}


def turned(tracks: Tracks, source: str, up: str) -> Tracks:
    """From the axes `source` ("camera", "y", or "z" upwards) to those with `up`, y or z."""
    # No zero is negative, which would be written as -0.
    R = _TO_Y[up].T @ _TO_Y[source]
    return replace(tracks, points=tracks.points @ R.T + 0.0, sigma=tracks.sigma @ np.abs(R).T)


#: Most that a frame may be off the grid, in periods.
JITTER = 0.1
#: Frames that are always filled up to, and so many times those that there are: a single wrong time
#: must not become a million frames.
_MOST, _TIMES = 65_535, 4


@dataclass(frozen=True)
class FrameGrid:
    """Times (t,) s as `start` + `period` * `index` (t,), and how far each is `off`, in periods."""

    index: Int
    start: float
    period: float
    off: Float

    @property
    def even(self) -> bool:
        """Whether the frames have one rate."""
        return bool((np.diff(self.index) >= 1).all() and self.off.max() <= JITTER)

    @property
    def gaps(self) -> int:
        """Frames that are missing."""
        return int(self.index[-1]) + 1 - len(self.index)


@dataclass(frozen=True)
class WrittenFrames:
    """What was written: `frames`, at `rate` Hz, None where times are uneven; of these `gaps` that
    the tracks did not have; `moved` s, by which times are others in the file at most."""

    frames: int
    rate: float | None
    gaps: int
    moved: float = 0.0

    @property
    def told(self) -> str:
        """In words."""
        if self.rate is None:
            at = " at uneven times" if self.frames > 1 else ""
            return f"{self.frames} frame{'' if self.frames == 1 else 's'}{at}"
        out = f"{self.frames} frames at {self.rate:.6g} Hz"
        if self.gaps:
            out += f", {self.gaps} of them dropped ones without markers"
        if self.moved > 1e-6:
            out += f", times moved by up to {1e3 * self.moved:.3g} ms to be even"
        return out


def frame_grid(time: Float) -> FrameGrid | None:
    """The grid that is nearest to increasing times (t,) s; None for less than two."""
    if len(time) < 2:
        return None
    steps = np.diff(time)
    # Of the shorter steps, since more than half of the frames may have been dropped.
    ones = np.rint(steps / np.quantile(steps, 0.1, method="lower")) == 1
    index = np.concatenate([[0], np.cumsum(np.rint(steps / steps[ones].mean()))]).astype(np.int64)
    away = index - index.mean()
    period = float(away @ time / (away @ away)) if away.any() else float(steps.mean())
    start = float(time.mean() - period * index.mean())
    return FrameGrid(index, start, period, np.abs(time - start - period * index) / period)


def on_even_frames(tracks: Tracks) -> tuple[Tracks, WrittenFrames]:
    """Tracks with all frames from the first to the last, numbered on from the first one's number;
    as they are where their times are uneven, or nearly all frames would be missing ones."""
    grid = frame_grid(tracks.time)
    if grid is None or not grid.even:
        return tracks, WrittenFrames(len(tracks.time), None, 0)
    rate, count = 1 / grid.period, int(grid.index[-1]) + 1
    if count > max(_MOST, _TIMES * len(tracks.time)):
        return tracks, WrittenFrames(len(tracks.time), rate, 0)
    frame = tracks.frame[0] + np.arange(count)
    if not grid.gaps:
        whole = Tracks(tracks.time, tracks.ids, tracks.points, tracks.sigma, frame)
        return whole, WrittenFrames(count, rate, 0)
    time = np.asarray(grid.start + grid.period * np.arange(count), float)
    time[grid.index] = tracks.time
    points = np.full((count, *tracks.points.shape[1:]), np.nan)
    sigma = points.copy()
    points[grid.index], sigma[grid.index] = tracks.points, tracks.sigma
    whole = Tracks(time, tracks.ids, points, sigma, frame)
    return whole, WrittenFrames(count, rate, grid.gaps)
