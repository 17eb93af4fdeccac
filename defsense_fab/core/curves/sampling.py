"""Values between samples."""

from __future__ import annotations

import numpy as np

from ..arrays import Bool, Float

_ROUNDING = 2e-6  # s, by which times in different files differ


def at_times(when: Float, time: Float, values: Float, gap: float = 0.25) -> Float:
    """Values (n, d) with increasing times (n,) s at other times (t,) s: linear in between, NaN
    outside and in gaps of over `gap` s. Times that differ by what files round off are the same."""
    if len(time) < 2:
        return np.full((len(when), values.shape[1]), np.nan)
    k = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    after = when - time[k - 1]
    span = time[k] - time[k - 1]
    before_it, at_it = np.abs(after) < _ROUNDING, np.abs(after - span) < _ROUNDING
    x = np.where(before_it, 0.0, np.where(at_it, 1.0, after / span))
    out = values[k - 1] + x[:, None] * (values[k] - values[k - 1])
    exact = before_it | at_it
    out[before_it], out[at_it] = values[k - 1][before_it], values[k][at_it]
    between: Bool = (x > 0) & (x < 1) & (span <= gap)
    out[~(exact | between)] = np.nan
    return np.asarray(out)
