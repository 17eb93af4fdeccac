"""Errors of a trained model on test frames: in total, and by marker, pose, speed and time.

The measures are those of DefSense's Table 1.
The error of a marker is its distance from the predicted position; that of a frame is the root mean
square over its visible markers. Gaps never count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import TrainingError
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Dataset
from .decoded_frames import DecodedFrames, decode_frames, match_to_model
from .marker_motion import outward_component, rms_length, velocities

_SPEED_BINS = 12  # half of them for either direction
_MIN_BIN_FRAMES = 5
_TENTHS = 10


@dataclass(frozen=True)
class Measures:
    """Error measures of DefSense's Table 1.

    Attributes:
        rmse: Root mean square error over the frames, mm.
        deviation: Standard deviation of the frames' errors, mm.
        peak: Largest error of any marker, mm.
        average_peak: Mean over the frames of each one's largest marker error, mm.
        frames: Number of frames.
    """

    rmse: float
    deviation: float
    peak: float
    average_peak: float
    frames: int


@dataclass(frozen=True)
class SpeedBins:
    """Errors by the speed of the markers, which is negative when the device returns to rest.

    Attributes:
        edges: Edges of the bins, shape (b + 1,), mm/s; the first and last bins include all beyond.
        frames: Number of frames in each bin, shape (b,).
        rmse: Root mean square error, shape (b,), mm; NaN in bins with few frames.
        too_far: Mean outward component of the error, shape (b,), mm. Hysteresis gives it opposite
            signs in the two directions.
    """

    edges: Float
    frames: Int
    rmse: Float
    too_far: Float


@dataclass(frozen=True)
class IntervalCoverage:
    """Shares of marker positions inside their intervals.

    Attributes:
        level: The share that is intended.
        share: Share of all positions.
        by_pose: Share for each pose, shape (p,).
        by_pose_error: Standard errors of these shares between repetitions, shape (p,), since
            neighboring frames are not independent; NaN for a pose that was shown once.
        by_tenth: Share in each tenth of the tested time, shape (10,); NaN without frames.
        radius: Mean radius of the intervals, mm.
    """

    level: float
    share: float
    by_pose: Float
    by_pose_error: Float
    by_tenth: Float
    radius: float


@dataclass(frozen=True)
class Evaluation:
    """Errors of a model on test frames.

    Attributes:
        frames: The decoded frames.
        total: Errors over all frames.
        by_pose: Errors for each of the p poses.
        marker_rmse: Root mean square error of each marker, shape (m,), mm; NaN if never visible.
        marker_peak: Largest error of each marker, shape (m,), mm; NaN if never visible.
        speed: Root mean square speed of the markers, shape (t,), mm/s; negative when the device
            returns to rest.
        too_far: Outward component of each frame's error, shape (t,), mm.
        by_speed: Errors by speed.
        coverage: Coverage of the intervals; None if the model has none.
        inside: Errors within the trained range; None without such frames.
        outside: Errors beyond the trained range; None without such frames.
        camera_noise: Root mean square of the stated standard deviations of the marker positions,
            mm; None if unknown.
    """

    frames: DecodedFrames
    total: Measures
    by_pose: tuple[Measures, ...]
    marker_rmse: Float
    marker_peak: Float
    speed: Float
    too_far: Float
    by_speed: SpeedBins
    coverage: IntervalCoverage | None
    inside: Measures | None
    outside: Measures | None
    camera_noise: float | None

    @property
    def rmse_without_noise(self) -> float | None:
        """sqrt(rmse^2 - camera_noise^2), mm, at least 0; None if the noise is unknown."""
        if self.camera_noise is None:
            return None
        return float(np.sqrt(max(self.total.rmse**2 - self.camera_noise**2, 0.0)))


def evaluate(model: TrainedModel, dataset: Dataset, last_share: float = 1.0) -> Evaluation:
    """Evaluate a model on the last frames of a dataset.

    Args:
        model: The model.
        dataset: The dataset, of the model's device and layout.
        last_share: Share of the frames to test on, at the end of all runs.

    Returns:
        The errors.

    Raises:
        TrainingError: If the model does not match the dataset, or no frame can be tested.
    """
    frames = decode_frames(model, dataset, last_share)
    rest_points = match_to_model(model, dataset).rest_points
    total = measure_frames(frames)
    displacements = frames.measured - rest_points
    velocity = velocities(frames.time, frames.measured, frames.run)
    with np.errstate(invalid="ignore"):
        is_returning = outward_component(velocity, displacements) < 0
        speed = rms_length(velocity) * np.where(is_returning, -1.0, 1.0)
    too_far = outward_component(frames.error, displacements)
    is_inside = frames.is_inside
    squares = np.where(frames.visible, frames.marker_error**2, 0.0).sum(0)
    with np.errstate(all="ignore"):
        mean_squares = squares / frames.visible.sum(0)
    peak = np.where(frames.visible, frames.marker_error, -1.0).max(axis=0)
    level = model.main.intervals.level if model.main.intervals else None
    return Evaluation(
        frames=frames,
        total=total,
        by_pose=tuple(measure_frames(frames, frames.pose == k) for k in range(len(frames.poses))),
        marker_rmse=np.sqrt(mean_squares),
        marker_peak=np.where(peak < 0, np.nan, peak),
        speed=speed,
        too_far=too_far,
        by_speed=_group_by_speed(speed, frames.frame_error, too_far),
        coverage=None if level is None else _measure_coverage(frames, level),
        inside=measure_frames(frames, is_inside) if is_inside.any() else None,
        outside=measure_frames(frames, ~is_inside) if (~is_inside).any() else None,
        camera_noise=_measure_camera_noise(frames),
    )


def measure_frames(frames: DecodedFrames, which: Bool | None = None) -> Measures:
    """Measure the errors of frames.

    Args:
        frames: The decoded frames.
        which: Mask of the frames to use, shape (t,); None for all.

    Returns:
        The errors.

    Raises:
        TrainingError: If there are no frames.
    """
    is_used = np.ones(len(frames.time), bool) if which is None else which
    if not is_used.any():
        raise TrainingError("there are no frames to measure errors of", code="no-frames")
    errors = frames.frame_error[is_used]
    largest = np.nanmax(frames.marker_error[is_used], axis=1)
    return Measures(
        rmse=float(np.sqrt((errors**2).mean())),
        deviation=float(errors.std()),
        peak=float(largest.max()),
        average_peak=float(largest.mean()),
        frames=int(is_used.sum()),
    )


def _measure_camera_noise(frames: DecodedFrames) -> float | None:
    """Return the RMS standard deviation of the marker positions in mm; None if none is known."""
    variance = (frames.sigma**2).sum(axis=2)
    is_known = frames.visible & np.isfinite(variance)
    weight = np.where(is_known, frames.weights, 0.0)
    if not weight.any():
        return None
    return float(np.sqrt((weight * np.where(is_known, variance, 0.0)).sum() / weight.sum()))


def _group_by_speed(speed: Float, errors: Float, too_far: Float) -> SpeedBins:
    is_known = np.isfinite(speed)
    largest = float(np.quantile(np.abs(speed[is_known]), 0.98)) if is_known.any() else 0.0
    edges = np.linspace(-1, 1, _SPEED_BINS + 1) * (largest or 1.0)
    bins = np.digitize(speed, edges[1:-1])
    frames = np.array([int((is_known & (bins == k)).sum()) for k in range(_SPEED_BINS)])
    rmse, outward = np.full(_SPEED_BINS, np.nan), np.full(_SPEED_BINS, np.nan)
    for k in np.flatnonzero(frames >= _MIN_BIN_FRAMES):
        is_in_bin = is_known & (bins == k)
        rmse[k] = np.sqrt((errors[is_in_bin] ** 2).mean())
        components = too_far[is_in_bin & np.isfinite(too_far)]
        # There are no components for a device that is exactly at rest.
        outward[k] = components.mean() if len(components) else np.nan
    return SpeedBins(edges, frames, rmse, outward)


def _measure_coverage(frames: DecodedFrames, level: float) -> IntervalCoverage:
    is_covered = frames.marker_error <= frames.radius
    tenth = np.minimum((_TENTHS * frames.elapsed / (frames.elapsed[-1] or 1)).astype(int), 9)
    poses = range(len(frames.poses))

    def share_of(which: Bool) -> float:
        visible = frames.visible[which]
        return float(is_covered[which][visible].mean()) if visible.any() else np.nan

    return IntervalCoverage(
        level=level,
        share=share_of(np.ones(len(tenth), bool)),
        by_pose=np.array([share_of(frames.pose == k) for k in poses]),
        by_pose_error=np.array([_coverage_error(frames, is_covered, k) for k in poses]),
        by_tenth=np.array([share_of(tenth == k) for k in range(_TENTHS)]),
        radius=float(frames.radius[frames.visible].mean()),
    )


def _coverage_error(frames: DecodedFrames, is_covered: Bool, pose: int) -> float:
    """Return the standard error of a pose's coverage (t, m) between its repetitions."""
    index = np.flatnonzero(frames.pose == pose)
    ends = np.flatnonzero((np.diff(index) > 1) | (np.diff(frames.run[index]) != 0)) + 1
    repetitions = np.split(index, ends)
    visible = np.array([frames.visible[s].sum() for s in repetitions], float)
    inside = np.array([is_covered[s][frames.visible[s]].sum() for s in repetitions], float)
    n = len(repetitions)
    if n < 2:
        return np.nan
    deviation = inside - visible * inside.sum() / visible.sum()
    return float(np.sqrt(n / (n - 1) * (deviation**2).sum()) / visible.sum())
