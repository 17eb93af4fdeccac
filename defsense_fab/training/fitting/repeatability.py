"""Measure how much a decoder's output differs when one shape is shown at different times.

Two frames whose markers agree within the noise of the cameras show the same shape. Their signals
differ by read-out noise and by what a cord does not repeat: friction, relaxation that a memory does
not undo, joints, drift, and clock errors during movement. The displacements that decoders of the
folds left out give for both frames are compared; their difference is the decoder's slope times the
difference of the signals. Half its mean square is the variance of a single show. Errors that recur
with a shape, which are the decoder's own, are not included.

Shapes are compared in the few directions in which markers move together, which hardly contain the
noise of single markers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, Int
from ..regression.frames import Frames

_MAX_FRAMES = 2000  # evenly spaced frames among which pairs are searched
_MIN_PAIRS = 100
_MIN_LAG_S = 5.0  # between the frames of a pair
_MAX_DIRECTIONS = 12
_GAP_FILL_ROUNDS = 6
_SAME_SHAPE_SHARE = 0.02  # of the markers' movement, where the noise of the cameras is unknown
_MAX_FRAME_GAP_S = 0.25  # frames further apart are not neighbors


@dataclass(frozen=True)
class Repeatability:
    """Mean squares of the differences between shows of one shape, mm^2.

    Attributes:
        at_once: Variance of the decoded shape in shows right after each other.
        drift: Additional variance of shows as far apart as most of the training's.
        cameras: Variance of the marker positions as stated by the cameras.
        clocks: Standard error of the clock synchronization times the markers' speed, squared;
            `at_once` contains it.
        share: Share of the examined frames whose shape was shown again.
    """

    at_once: float
    drift: float
    cameras: float
    clocks: float
    share: float


def measure_repeatability(frames: Frames, decoded: Float) -> Repeatability | None:
    """Measure the repeatability of decoded displacements.

    Args:
        frames: The t frames.
        decoded: Displacements by decoders that were not trained on these frames, shape (t, m, 3),
            mm.

    Returns:
        The mean squares; None if too few shapes are shown again.
    """
    shown, predicted = _project_shapes(frames, decoded)
    subset = np.unique(np.linspace(0, len(frames) - 1, _MAX_FRAMES).astype(int))
    variance = (frames.sigma**2).sum(axis=2)[frames.visible]
    variance = variance[np.isfinite(variance)]
    cameras = float(variance.mean()) if len(variance) else 0.0
    movement = float(np.sqrt(shown.var(axis=0).sum()))
    tolerance = max(np.sqrt(cameras), _SAME_SHAPE_SHARE * movement)
    i, j = _find_pairs(frames, subset, shown[subset], tolerance)
    if len(i) < _MIN_PAIRS:
        return None
    square = (((predicted[i] - predicted[j]) - (shown[i] - shown[j])) ** 2).sum(axis=1) / 2
    partners = np.bincount(np.concatenate([i, j]), minlength=len(frames))
    weight = 1 / partners[i] + 1 / partners[j]  # so that all frames count alike
    at_once, drift = _split_by_lag(np.abs(frames.time[i] - frames.time[j]), square, weight)
    share = float((partners[subset] > 0).mean())
    return Repeatability(at_once, drift, cameras, _clock_variance(frames, shown), share)


def _project_shapes(frames: Frames, decoded: Float) -> tuple[Float, Float]:
    """Return measured and decoded shapes (t, k) in the markers' main directions.

    Lengths are root mean squares over the markers, in mm.
    """
    displacements = frames.points - frames.dataset.rest_points
    measured = displacements.reshape(len(frames), -1)
    predicted = decoded.reshape(len(frames), -1)
    is_known = np.isfinite(measured)
    center = np.where(is_known, measured, 0).sum(0) / np.maximum(is_known.sum(0), 1)
    x = np.where(is_known, measured - center, 0.0)
    directions = np.eye(x.shape[1])
    for _ in range(_GAP_FILL_ROUNDS):
        directions = np.linalg.eigh(x.T @ x)[1][:, -_MAX_DIRECTIONS:]
        x = np.where(is_known, x, x @ directions @ directions.T)
    scale = np.sqrt(displacements.shape[1])
    return x @ directions / scale, (predicted - center) @ directions / scale


def _find_pairs(frames: Frames, subset: Int, shown: Float, tolerance: float) -> tuple[Int, Int]:
    """Return pairs of frames of one recording that show the same shape at different times."""
    pairs = cKDTree(shown).query_pairs(tolerance, output_type="ndarray")
    i, j = subset[pairs[:, 0]], subset[pairs[:, 1]]
    is_separate = np.abs(frames.time[i] - frames.time[j]) >= _MIN_LAG_S
    is_pair = (frames.recording_index[i] == frames.recording_index[j]) & is_separate
    return i[is_pair], j[is_pair]


def _split_by_lag(lag: Float, square: Float, weight: Float) -> tuple[float, float]:
    """Split the mean of squares into its part at lag 0 and the increase with lag.

    Both are from a line by weighted least squares, and neither is negative.
    """
    weight = weight / weight.sum()
    center, mean = float(weight @ lag), float(weight @ square)
    spread = float(weight @ (lag - center) ** 2)
    slope = float(weight @ ((lag - center) * square)) / spread if spread > 0 else 0.0
    increase = min(max(slope * center, 0.0), mean)
    return mean - increase, increase


def _clock_variance(frames: Frames, shown: Float) -> float:
    """Return the mean square (mm^2) of clock errors of one standard error."""
    errors = np.array([r.sync_error or 0.0 for r in frames.dataset.recordings])
    error = errors[frames.recording_index]
    step = frames.time[2:] - frames.time[:-2]
    is_same_run = frames.recording_index[2:] == frames.recording_index[:-2]
    is_near = is_same_run & (step > 0) & (step <= _MAX_FRAME_GAP_S)
    if not is_near.any():
        return 0.0
    square = ((shown[2:] - shown[:-2])[is_near] ** 2).sum(axis=1) / step[is_near] ** 2
    return float((error[1:-1][is_near] ** 2 * square).mean())
