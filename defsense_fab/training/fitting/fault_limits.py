"""Limits beyond which a channel's signal is a fault, from the recordings of a training."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...decoding.channel_faults import FaultLimits, constant_duration, rms_jumps
from ..data.dataset import Dataset

_RANGE_MARGIN = 3.0  # widths of the range, beyond the range seen in training
_MIN_MARGIN = 0.5  # (R - R0)/R0, for a cord that was hardly moved
_SHORT_CIRCUIT = -0.8  # (R - R0)/R0; a cord with a fifth of its resistance is not compressed
_RARE_SHARE = 1e-3  # of the samples may be beyond the range
_STILL_RATIO = 3.0  # times the longest time without a change, plus the following margin
_STILL_MARGIN_S = 0.5
_MOVEMENT_SHARE = 0.1  # of its range, by which another channel must move meanwhile
_REPEAT_PROBABILITY = 1e-9  # that so many samples in a row are equal by noise
_REPEAT_MARGIN = 0.1  # added to the share of equal neighbors seen in training
_REPEAT_WINDOW_S = 10.0  # over which equal neighbors are counted
_NEVER_S = 1e6  # for channels whose samples are often equal: they are never stuck for that reason
_JUMP_RATIO = 8.0  # times the roughness of all but a hundredth of the seconds


def fit_fault_limits(dataset: Dataset) -> FaultLimits:
    """Derive the limits of each channel from all recordings.

    Samples at which a cord was torn while recording do not count.

    Args:
        dataset: The training data.

    Returns:
        The limits of the c channels.
    """
    c = len(dataset.channels)
    low, high = np.full(c, np.inf), np.full(c, -np.inf)
    still, jump, repeats = np.zeros(c), np.zeros(c), np.zeros(c)
    for r in dataset.recordings:
        for k in range(c):
            is_known = np.isfinite(r.signals[:, k])
            if is_known.sum() < 2:
                continue
            s, time = r.signals[is_known, k], r.sample_time[is_known]
            lowest, highest = np.quantile(s, [_RARE_SHARE, 1 - _RARE_SHARE])
            low[k], high[k] = min(low[k], float(lowest)), max(high[k], float(highest))
            still[k] = max(
                still[k], float(np.quantile(constant_duration(time, s), 1 - _RARE_SHARE))
            )
            repeats[k] = max(repeats[k], _repeat_limit(time, s))
            jumps = rms_jumps(time, s)[time > time[0] + 1]
            jump[k] = max(jump[k], float(np.quantile(jumps, 0.99)) if len(jumps) else 0.0)
    width = np.maximum(high - low, 1e-9)
    margin = np.maximum(_RANGE_MARGIN * width, _MIN_MARGIN)
    return FaultLimits(
        low=np.maximum(low - margin, np.minimum(_SHORT_CIRCUIT, low - 0.1)),
        high=high + margin,
        still=_STILL_RATIO * still + _STILL_MARGIN_S,
        moves=_MOVEMENT_SHARE * width,
        jump=_JUMP_RATIO * jump,
        repeats=np.where(repeats > 0, np.minimum(repeats, _NEVER_S), _NEVER_S),
    )


def _repeat_limit(time: Float, signal: Float) -> float:
    """Return the time in s for which a signal (n,) is never exactly constant by chance.

    It is infinite for a signal that often repeats itself.
    """
    is_equal, step = np.diff(signal) == 0, float(np.median(np.diff(time)))
    count = max(round(_REPEAT_WINDOW_S / step), 1)
    if len(is_equal) < count:
        return np.inf
    total = np.cumsum(np.append(0, is_equal))
    share = float((total[count:] - total[:-count]).max()) / count + _REPEAT_MARGIN
    return float(np.log(_REPEAT_PROBABILITY) / np.log(share)) * step if share < 1 else np.inf
