"""Limits beyond which a channel's signal is a fault, from the recordings that were trained on."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...decoding.channel_faults import FaultLimits, second_jumps, unchanged
from ..data.dataset import Dataset

#: Beyond the range that was seen, in its width; at least so much, for a cord that was hardly moved.
_BEYOND, _LEAST = 3.0, 0.5
_SHORT = -0.8  # (R - R0)/R0 of a cord of which a fifth is left is no compression
_RARE = 1e-3  # of the samples may be beyond what counts as seen
_STILL = 3.0  # times the longest time without a change, and so many s more
_MORE = 0.5
_MOVES = 0.1  # of its range, by which another channel must move meanwhile
_CHANCE = 1e-9  # that so many samples in a row are the same by noise
_SPARE = 0.1  # more often than in training may one sample be the same as the one before
_WINDOW = 10.0  # s, over which that is counted
_NEVER = 1e6  # s, of a channel whose samples are often the same: it is not stuck for that
_JUMP = 8.0  # times as rough as all but a hundredth of the seconds


def fault_limits(dataset: Dataset) -> FaultLimits:
    """Of all recordings of a dataset; what was torn while it was recorded is not counted."""
    c = len(dataset.channels)
    low, high = np.full(c, np.inf), np.full(c, -np.inf)
    still, jump, repeats = np.zeros(c), np.zeros(c), np.zeros(c)
    for r in dataset.recordings:
        for k in range(c):
            good = np.isfinite(r.signals[:, k])
            if good.sum() < 2:
                continue
            s, time = r.signals[good, k], r.sample_time[good]
            least, most = np.quantile(s, [_RARE, 1 - _RARE])
            low[k], high[k] = min(low[k], float(least)), max(high[k], float(most))
            still[k] = max(still[k], float(np.quantile(unchanged(time, s), 1 - _RARE)))
            repeats[k] = max(repeats[k], _repeats(time, s))
            rough = second_jumps(time, s)[time > time[0] + 1]
            jump[k] = max(jump[k], float(np.quantile(rough, 0.99)) if len(rough) else 0.0)
    width = np.maximum(high - low, 1e-9)
    more = np.maximum(_BEYOND * width, _LEAST)
    lowest = np.maximum(low - more, np.minimum(_SHORT, low - 0.1))
    return FaultLimits(
        lowest, high + more, _STILL * still + _MORE, _MOVES * width, _JUMP * jump,
        np.where(repeats > 0, np.minimum(repeats, _NEVER), _NEVER),
    )  # fmt: skip


def _repeats(time: Float, signal: Float) -> float:
    """s for which a signal (n,) is never exactly the same by chance; infinite where it often is."""
    same, span = np.diff(signal) == 0, float(np.median(np.diff(time)))
    many = max(round(_WINDOW / span), 1)
    if len(same) < many:
        return np.inf
    total = np.cumsum(np.append(0, same))
    often = float((total[many:] - total[:-many]).max()) / many + _SPARE
    return float(np.log(_CHANCE) / np.log(often)) * span if often < 1 else np.inf
