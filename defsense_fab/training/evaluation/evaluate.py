"""How good a trained model is on frames that it is tested on: DefSense's Table 1, and where, when
and in which motion the errors are.

The error of a marker is its distance from where it was said to be; that of a frame is the root
mean square over the markers that were seen in it. Gaps never count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import TrainingError
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Dataset
from .decoded_frames import DecodedFrames, decode_frames, matched
from .marker_motion import outwards, rms, velocities

_BINS = 12  # of speed, half of them for either direction
_FEWEST = 5  # frames that a bin must have
_TENTHS = 10


@dataclass(frozen=True)
class Measures:
    """As in DefSense's Table 1, mm: `rmse` over `frames`, the standard deviation of the frames'
    errors (`deviation`), the largest error of any marker (`peak`), and the mean over frames of
    each one's largest (`average_peak`)."""

    rmse: float
    deviation: float
    peak: float
    average_peak: float
    frames: int


@dataclass(frozen=True)
class SpeedBins:
    """Frames by the speed of their markers (root mean square, mm/s), less than 0 where the device
    comes back to rest: `edges` (b + 1,), the first and last bin taking all beyond; of each bin the
    number of `frames` (b,), `rmse` (b,) mm, and by how much it is said to be too far out, `too_far`
    (b,) mm, which hysteresis sets apart in both directions. NaN in bins of few frames."""

    edges: Float
    frames: Int
    rmse: Float
    too_far: Float


@dataclass(frozen=True)
class Coverage:
    """Shares of marker positions that were inside of their intervals, which ought to be `level`: of
    all, of each pose (p,), and of each tenth of the tested time (10,); NaN where there was nothing.
    `by_pose_error` (p,) are the standard errors of the poses' shares, from one show to another,
    NaN of a pose that was shown once: neighbouring pictures are not independent. `radius` is the
    mean half width, mm."""

    level: float
    share: float
    by_pose: Float
    by_pose_error: Float
    by_tenth: Float
    radius: float


@dataclass(frozen=True)
class Evaluation:
    """Of the tested `frames`: `total` and `by_pose` (p); per marker (m,) mm its root mean square
    `marker_rmse` and largest error `marker_peak`, NaN of one that was never seen. `speed` (t,) mm/s
    is less than 0 where the device comes back, and `too_far` (t,) mm how much too far out it is
    said to be. `inside` and `outside` are frames at distances up to 1 from the trained range, and
    beyond, None where there are none. `camera_noise` mm is the root mean square of the cameras'
    own standard deviations where they are known, None where they are not; `rmse_without_noise` is
    sqrt(rmse^2 - camera_noise^2), 0 where that is less than nothing."""

    frames: DecodedFrames
    total: Measures
    by_pose: tuple[Measures, ...]
    marker_rmse: Float
    marker_peak: Float
    speed: Float
    too_far: Float
    by_speed: SpeedBins
    coverage: Coverage | None
    inside: Measures | None
    outside: Measures | None
    camera_noise: float | None
    rmse_without_noise: float | None


def evaluate(model: TrainedModel, dataset: Dataset, last_share: float = 1.0) -> Evaluation:
    """The model's errors on the last share of the pictures. Raises TrainingError where
    they do not go together, or nothing can be tested."""
    frames = decode_frames(model, dataset, last_share)
    rest = matched(model, dataset).rest_points
    total = measures(frames)
    moved = frames.measured - rest
    velocity = velocities(frames.time, frames.measured, frames.run)
    with np.errstate(invalid="ignore"):
        speed = rms(velocity) * np.where(outwards(velocity, moved) < 0, -1.0, 1.0)
    too_far = outwards(frames.error, moved)
    noise = camera_noise(frames)
    near = np.asarray(frames.distance <= 1)
    with np.errstate(all="ignore"):
        sums = np.where(frames.visible, frames.miss**2, 0.0).sum(0) / frames.visible.sum(0)
    peak = np.where(frames.visible, frames.miss, -1.0).max(axis=0)
    level = model.main.intervals.level if model.main.intervals else None
    return Evaluation(
        frames=frames,
        total=total,
        by_pose=tuple(measures(frames, frames.pose == k) for k in range(len(frames.poses))),
        marker_rmse=np.sqrt(sums),
        marker_peak=np.where(peak < 0, np.nan, peak),
        speed=speed,
        too_far=too_far,
        by_speed=_by_speed(speed, frames.per_frame, too_far),
        coverage=None if level is None else _coverage(frames, level),
        inside=measures(frames, near) if near.any() else None,
        outside=measures(frames, ~near) if (~near).any() else None,
        camera_noise=noise,
        rmse_without_noise=(
            None if noise is None else float(np.sqrt(max(total.rmse**2 - noise**2, 0.0)))
        ),
    )


def measures(frames: DecodedFrames, which: Bool | None = None) -> Measures:
    """Of all frames, or of those of a mask (t,). Raises TrainingError where there are none."""
    own = np.ones(len(frames.time), bool) if which is None else which
    if not own.any():
        raise TrainingError("there are no frames to measure errors of", code="no-frames")
    errors = frames.per_frame[own]
    largest = np.nanmax(frames.miss[own], axis=1)
    return Measures(
        rmse=float(np.sqrt((errors**2).mean())),
        deviation=float(errors.std()),
        peak=float(largest.max()),
        average_peak=float(largest.mean()),
        frames=int(own.sum()),
    )


def camera_noise(frames: DecodedFrames) -> float | None:
    """Root mean square, mm, of the standard deviations of markers' positions, all axes together;
    over those that are known, None where none are."""
    variance = (frames.sigma**2).sum(axis=2)
    known = frames.visible & np.isfinite(variance)
    weight = np.where(known, frames.weights, 0.0)
    if not weight.any():
        return None
    return float(np.sqrt((weight * np.where(known, variance, 0.0)).sum() / weight.sum()))


def _by_speed(speed: Float, errors: Float, too_far: Float) -> SpeedBins:
    known = np.isfinite(speed)
    most = float(np.quantile(np.abs(speed[known]), 0.98)) if known.any() else 0.0
    edges = np.linspace(-1, 1, _BINS + 1) * (most or 1.0)
    bins = np.digitize(speed, edges[1:-1])
    frames = np.array([int((known & (bins == k)).sum()) for k in range(_BINS)])
    rmse, far = np.full(_BINS, np.nan), np.full(_BINS, np.nan)
    for k in np.flatnonzero(frames >= _FEWEST):
        own = known & (bins == k)
        rmse[k] = np.sqrt((errors[own] ** 2).mean())
        apart = too_far[own & np.isfinite(too_far)]
        far[k] = apart.mean() if len(apart) else np.nan  # none of a device that is exactly at rest
    return SpeedBins(edges, frames, rmse, far)


def _coverage(frames: DecodedFrames, level: float) -> Coverage:
    covered = frames.miss <= frames.radius
    tenth = np.minimum((_TENTHS * frames.elapsed / (frames.elapsed[-1] or 1)).astype(int), 9)

    def share(of: Bool) -> float:
        seen = frames.visible[of]
        return float(covered[of][seen].mean()) if seen.any() else np.nan

    return Coverage(
        level=level,
        share=share(np.ones(len(tenth), bool)),
        by_pose=np.array([share(frames.pose == k) for k in range(len(frames.poses))]),
        by_pose_error=np.array(
            [_between_shows(frames, covered, k) for k in range(len(frames.poses))]
        ),
        by_tenth=np.array([share(tenth == k) for k in range(_TENTHS)]),
        radius=float(frames.radius[frames.visible].mean()),
    )


def _between_shows(frames: DecodedFrames, covered: Bool, pose: int) -> float:
    """Standard error of a pose's share inside (t, m), from shows that follow each other."""
    own = np.flatnonzero(frames.pose == pose)
    ends = np.flatnonzero((np.diff(own) > 1) | (np.diff(frames.run[own]) != 0)) + 1
    shows = np.split(own, ends)
    seen = np.array([frames.visible[s].sum() for s in shows], float)
    inside = np.array([covered[s][frames.visible[s]].sum() for s in shows], float)
    n = len(shows)
    if n < 2:
        return np.nan
    off = inside - seen * inside.sum() / seen.sum()
    return float(np.sqrt(n / (n - 1) * (off**2).sum()) / seen.sum())
