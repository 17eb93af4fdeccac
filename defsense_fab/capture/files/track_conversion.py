"""Prepare tracks for motion-capture formats: axes and even frames.

Formats of motion capture have one rate and every frame. To make tracks alike in every format, all
formats get the frames that a camera dropped, as frames without markers. Positions are never
interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.markers import Tracks

#: Rotation to axes with y upwards, from each kind of axes.
_TO_Y_UP = {
    "camera": np.diag([1.0, -1.0, -1.0]),
    "y": np.eye(3),
    "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}
#: Descriptions of the kinds of axes.
AXES = {
    "camera": "x right, y down, z ahead",
    "y": "x right, y up, z back",
    "z": "x right, y ahead, z up",
}
MAX_JITTER = 0.1  # periods by which a frame may be off the grid
#: Missing frames are filled up to this count, or to this multiple of the frames that there are, so
#: that a single wrong time does not become a million frames.
MAX_FILLED_FRAMES, MAX_FILLED_FACTOR = 65_535, 4


def change_axes(tracks: Tracks, source: str, up: str) -> Tracks:
    """Turn tracks by quarter turns, so that another axis points upwards.

    Args:
        tracks: Tracks to turn.
        source: Present axes: `camera`, or the axis that points upwards, `y` or `z`.
        up: Axis that shall point upwards, `y` or `z`.
    """
    R = _TO_Y_UP[up].T @ _TO_Y_UP[source]
    # Adding zero removes negative zeros, which would be written as -0.
    return replace(tracks, points=tracks.points @ R.T + 0.0, sigma=tracks.sigma @ np.abs(R).T)


@dataclass(frozen=True)
class FrameGrid:
    """Times of t frames as start + period * index.

    Attributes:
        index: Grid position of each frame (t,).
        start: Time of index 0, s.
        period: Period of the grid, s.
        deviation: Distance of each frame from its grid position (t,), in periods.
    """

    index: Int
    start: float
    period: float
    deviation: Float

    @property
    def is_even(self) -> bool:
        """Whether the frames have one rate."""
        increases = bool((np.diff(self.index) >= 1).all())
        return increases and bool(self.deviation.max() <= MAX_JITTER)

    @property
    def gaps(self) -> int:
        """Number of missing frames."""
        return int(self.index[-1]) + 1 - len(self.index)


@dataclass(frozen=True)
class WrittenFrames:
    """Frames that were written to a file.

    Attributes:
        frames: Number of frames.
        rate: Frames per second, Hz; None if the times are uneven.
        gaps: Number of the frames that the tracks did not have.
        max_time_shift: Largest difference between the times of tracks and file, s.
    """

    frames: int
    rate: float | None
    gaps: int
    max_time_shift: float = 0.0

    @property
    def summary(self) -> str:
        """Description for messages."""
        if self.rate is None:
            times = " at uneven times" if self.frames > 1 else ""
            return f"{self.frames} frame{'' if self.frames == 1 else 's'}{times}"
        summary = f"{self.frames} frames at {self.rate:.6g} Hz"
        if self.gaps:
            summary += f", {self.gaps} of them dropped frames without markers"
        if self.max_time_shift > 1e-6:
            summary += f", times moved by up to {1e3 * self.max_time_shift:.3g} ms to be even"
        return summary


def frame_grid(time: Float) -> FrameGrid | None:
    """Fit a grid to increasing times (t,), s; None for fewer than two."""
    if len(time) < 2:
        return None
    steps = np.diff(time)
    # By the shorter steps, because more than half of the frames may have been dropped.
    is_single = np.rint(steps / np.quantile(steps, 0.1, method="lower")) == 1
    positions = np.concatenate([[0], np.cumsum(np.rint(steps / steps[is_single].mean()))])
    index = positions.astype(np.int64)
    centered = index - index.mean()
    if centered.any():
        period = float(centered @ time / (centered @ centered))
    else:
        period = float(steps.mean())
    start = float(time.mean() - period * index.mean())
    return FrameGrid(index, start, period, np.abs(time - start - period * index) / period)


def on_even_frames(tracks: Tracks) -> tuple[Tracks, WrittenFrames]:
    """Fill tracks up to all frames from the first to the last.

    Frames are numbered from the first one's number. Tracks with uneven times stay unchanged, and so
    do tracks of which nearly all frames would be missing.
    """
    grid = frame_grid(tracks.time)
    if grid is None or not grid.is_even:
        return tracks, WrittenFrames(len(tracks.time), None, 0)
    rate, count = 1 / grid.period, int(grid.index[-1]) + 1
    if count > max(MAX_FILLED_FRAMES, MAX_FILLED_FACTOR * len(tracks.time)):
        return tracks, WrittenFrames(len(tracks.time), rate, 0)
    frame = tracks.frame[0] + np.arange(count)
    if not grid.gaps:
        renumbered = Tracks(tracks.time, tracks.ids, tracks.points, tracks.sigma, frame)
        return renumbered, WrittenFrames(count, rate, 0)
    time = np.asarray(grid.start + grid.period * np.arange(count), float)
    time[grid.index] = tracks.time
    points = np.full((count, *tracks.points.shape[1:]), np.nan)
    sigma = points.copy()
    points[grid.index], sigma[grid.index] = tracks.points, tracks.sigma
    filled = Tracks(time, tracks.ids, points, sigma, frame)
    return filled, WrittenFrames(count, rate, grid.gaps)
