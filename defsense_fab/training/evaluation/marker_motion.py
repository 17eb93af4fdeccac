"""How quickly markers move, and whether the device goes out or comes back."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ..data.dataset import Recording

# How noisy the samples of a recording are, while the device is at rest.

_QUIET = 0.25  # share of the pictures, those in which markers move least
_NEAR_SAMPLE_NOISE = 0.1  # s from such a picture
_FEWEST = 20  # samples


def sample_noise(recording: Recording) -> Float:
    """Standard deviations (c,) of the signals' noise from sample to sample: of second differences,
    which know nothing of slow movement, near the pictures in which markers move least; of all
    samples where those are too few. 0 of a channel without samples."""
    signals, time = recording.signals, recording.sample_time
    second = signals[:-2] - 2 * signals[1:-1] + signals[2:]
    none = np.zeros(len(recording.time), int)
    speed = rms(velocities(recording.time, recording.points, none))
    quiet = np.zeros(len(time), bool)
    if np.isfinite(speed).any():
        limit = np.nanquantile(speed, _QUIET)
        at = np.concatenate([[-np.inf], recording.time[speed <= limit], [np.inf]])
        k = np.searchsorted(at, time)
        near = np.minimum(time - at[k - 1], at[k] - time)
        quiet = near <= _NEAR_SAMPLE_NOISE
    out = np.zeros(signals.shape[1])
    for c in range(len(out)):
        known = np.isfinite(second[:, c])
        own = known & quiet[1:-1]
        if own.sum() < _FEWEST:
            own = known
        if own.any():
            out[c] = np.sqrt((second[own, c] ** 2).mean() / 6)
    return out


_BESIDE = 2  # frames on either side
_NEAR = 0.25  # s: frames further apart are not neighbours


def velocities(time: Float, points: Float, run: Int) -> Float:
    """(t, m, 3) mm/s of markers (t, m, 3) mm at times (t,) s of runs (t,): slopes of the lines of
    least squares through each frame and two on either side, NaN of fewer than three."""
    shape = points.shape
    count, st, stt = (np.zeros(shape[:2]) for _ in range(3))
    sx, stx = np.zeros(shape), np.zeros(shape)
    for k in range(-_BESIDE, _BESIDE + 1):
        here = np.arange(len(time))
        there = np.clip(here + k, 0, len(time) - 1)
        dt = time[there] - time
        near = (there == here + k) & (run[there] == run) & (np.abs(dt) <= _NEAR)
        # Beside where the marker is: sums of large numbers would lose digits.
        moved = points[there] - points
        good = near[:, None] & np.isfinite(moved).all(axis=2)
        moved = np.where(good[..., None], moved, 0.0)
        when = np.where(good, dt[:, None], 0.0)
        count += good
        st += when
        stt += when**2
        sx += moved
        stx += when[..., None] * moved
    with np.errstate(all="ignore"):
        slope = (count[..., None] * stx - st[..., None] * sx) / (count * stt - st**2)[..., None]
    return np.where((count >= 3)[..., None], slope, np.nan)


def rms(vectors: Float) -> Float:
    """Root mean square (t,) of lengths of vectors (t, m, 3), NaN among them left out, and NaN where
    there are no others."""
    square = (vectors**2).sum(axis=2)
    known = np.isfinite(square)
    with np.errstate(all="ignore"):
        return np.asarray(np.sqrt(np.where(known, square, 0.0).sum(1) / known.sum(1)))


def outwards(vectors: Float, moved: Float) -> Float:
    """Part (t,) of vectors (t, m, 3) along what markers have `moved` from rest (t, m, 3), so that
    that of `moved` itself is its root mean square; over markers that have both."""
    known = np.isfinite(vectors).all(2) & np.isfinite(moved).all(2)
    along = np.where(known, (vectors * moved).sum(axis=2), 0.0).sum(1)
    size = np.where(known, (moved**2).sum(axis=2), 0.0).sum(1)
    with np.errstate(all="ignore"):
        return np.asarray(along / np.sqrt(size * known.sum(1)))
