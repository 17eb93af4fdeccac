"""Velocities of markers, their outward components, and signal noise while markers hardly move."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ..data.dataset import Recording

_NEIGHBORS = 2  # frames on either side
_MAX_FRAME_GAP_S = 0.25  # frames further apart are not neighbors
_QUIET_SHARE = 0.25  # of the frames: those in which markers move least
_MAX_QUIET_GAP_S = 0.1  # from a quiet frame to a sample
_MIN_QUIET_SAMPLES = 20


def velocities(time: Float, points: Float, run: Int) -> Float:
    """Compute the velocities of markers.

    They are slopes of least-squares lines through each frame and two frames on either side.

    Args:
        time: Times of the frames, shape (t,), s.
        points: Marker positions, shape (t, m, 3), mm.
        run: Index of each frame's run, shape (t,).

    Returns:
        Velocities, shape (t, m, 3), mm/s; NaN where fewer than three frames are known.
    """
    shape = points.shape
    count, st, stt = (np.zeros(shape[:2]) for _ in range(3))
    sx, stx = np.zeros(shape), np.zeros(shape)
    for k in range(-_NEIGHBORS, _NEIGHBORS + 1):
        index = np.arange(len(time))
        neighbor = np.clip(index + k, 0, len(time) - 1)
        dt = time[neighbor] - time
        is_near = (
            (neighbor == index + k) & (run[neighbor] == run) & (np.abs(dt) <= _MAX_FRAME_GAP_S)
        )
        # Relative to the marker's position: sums of large numbers would lose digits.
        dx = points[neighbor] - points
        is_used = is_near[:, None] & np.isfinite(dx).all(axis=2)
        dx = np.where(is_used[..., None], dx, 0.0)
        t = np.where(is_used, dt[:, None], 0.0)
        count += is_used
        st += t
        stt += t**2
        sx += dx
        stx += t[..., None] * dx
    with np.errstate(all="ignore"):
        slope = (count[..., None] * stx - st[..., None] * sx) / (count * stt - st**2)[..., None]
    return np.where((count >= 3)[..., None], slope, np.nan)


def rms_length(vectors: Float) -> Float:
    """Compute the root mean square length over the markers.

    Args:
        vectors: Vectors of the markers, shape (t, m, 3); NaN where unknown.

    Returns:
        The lengths, shape (t,); NaN where all vectors are unknown.
    """
    square = (vectors**2).sum(axis=2)
    is_known = np.isfinite(square)
    with np.errstate(all="ignore"):
        return np.asarray(np.sqrt(np.where(is_known, square, 0.0).sum(1) / is_known.sum(1)))


def outward_component(vectors: Float, displacements: Float) -> Float:
    """Compute the component of vectors along the displacements of the markers from rest.

    It is scaled so that the component of the displacements is their root mean square.

    Args:
        vectors: Vectors of the markers, shape (t, m, 3).
        displacements: Displacements of the markers from rest, shape (t, m, 3), mm.

    Returns:
        The components, shape (t,), over markers that have both.
    """
    is_known = np.isfinite(vectors).all(2) & np.isfinite(displacements).all(2)
    along = np.where(is_known, (vectors * displacements).sum(axis=2), 0.0).sum(1)
    size = np.where(is_known, (displacements**2).sum(axis=2), 0.0).sum(1)
    with np.errstate(all="ignore"):
        return np.asarray(along / np.sqrt(size * is_known.sum(1)))


def sample_noise(recording: Recording) -> Float:
    """Estimate the noise of the signals from sample to sample.

    It is computed from second differences, which slow movement does not affect, near the frames in
    which the markers move least; from all samples if those are too few.

    Args:
        recording: The recording.

    Returns:
        Standard deviations of the signals, shape (c,); 0 for a channel without samples.
    """
    signals, time = recording.signals, recording.sample_time
    second = signals[:-2] - 2 * signals[1:-1] + signals[2:]
    one_run = np.zeros(len(recording.time), int)
    speed = rms_length(velocities(recording.time, recording.points, one_run))
    is_quiet = np.zeros(len(time), bool)
    if np.isfinite(speed).any():
        limit = np.nanquantile(speed, _QUIET_SHARE)
        quiet_times = np.concatenate([[-np.inf], recording.time[speed <= limit], [np.inf]])
        k = np.searchsorted(quiet_times, time)
        gap = np.minimum(time - quiet_times[k - 1], quiet_times[k] - time)
        is_quiet = gap <= _MAX_QUIET_GAP_S
    noise = np.zeros(signals.shape[1])
    for c in range(len(noise)):
        is_known = np.isfinite(second[:, c])
        is_used = is_known & is_quiet[1:-1]
        if is_used.sum() < _MIN_QUIET_SAMPLES:
            is_used = is_known
        if is_used.any():
            noise[c] = np.sqrt((second[is_used, c] ** 2).mean() / 6)
    return noise
