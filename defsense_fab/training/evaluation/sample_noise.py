"""How noisy the samples of a recording are, while the device is at rest."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ..data.dataset import Recording
from .marker_motion import rms, velocities

_QUIET = 0.25  # share of the pictures, those in which markers move least
_NEAR = 0.1  # s from such a picture
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
        quiet = near <= _NEAR
    out = np.zeros(signals.shape[1])
    for c in range(len(out)):
        known = np.isfinite(second[:, c])
        own = known & quiet[1:-1]
        if own.sum() < _FEWEST:
            own = known
        if own.any():
            out[c] = np.sqrt((second[own, c] ** 2).mean() / 6)
    return out
