"""Signals over time: values between samples, and features of the signals' past.

Rubber cords relax, and are stiffer while they are stretched than while they return, so the same
signal belongs to different shapes. A cord that is a chain of relaxing elements (generalized
Maxwell) is inverted by exponential memories of its own signal. For each time constant T and each
signal s there are

    h = s - m,  m' = (s - m)/T        the distance from where it was: a rate for short T
    q' = |r'| - q/T                   how much it has moved, in either direction

where r is the signal without changes that last less than a fifth of a second, so that noise does
not count as movement. h is exact for signals that are linear between samples, at any sampling rate;
q is exact where r is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float
from ..core.machine.compiled import compiled

_TIME_ROUNDING_S = 2e-6  # by which the same times differ between files
_MAX_GAP_S = 0.25
_MAX_GAP_STEPS = 2.5  # times the step of slow samples
_STEP_PERCENTILE = 10  # of the times between samples, which is their step without gaps
_SMOOTHING_S = 0.2  # time constant of r


def interpolate_at(
    times: Float, sample_times: Float, values: Float, max_gap: float | None = None
) -> Float:
    """Interpolate samples linearly.

    Times that differ by the rounding of files are the same.

    Args:
        times: Times of the result (t,), s.
        sample_times: Times of the samples (n,), s, increasing.
        values: Samples (n, d).
        max_gap: Longest time between two samples to interpolate over, s; None for 0.25 s, or 2.5
            steps of slower samples.

    Returns:
        Values (t, d); NaN before the first and after the last sample, and in longer gaps.
    """
    if len(sample_times) < 2:
        return np.full((len(times), values.shape[1]), np.nan)
    if max_gap is None:
        step = float(np.percentile(np.diff(sample_times), _STEP_PERCENTILE))
        max_gap = max(_MAX_GAP_S, _MAX_GAP_STEPS * step)
    k = np.clip(np.searchsorted(sample_times, times), 1, len(sample_times) - 1)
    after = times - sample_times[k - 1]
    span = sample_times[k] - sample_times[k - 1]
    is_first, is_second = np.abs(after) < _TIME_ROUNDING_S, np.abs(after - span) < _TIME_ROUNDING_S
    x = np.where(is_first, 0.0, np.where(is_second, 1.0, after / span))
    out = values[k - 1] + x[:, None] * (values[k] - values[k - 1])
    is_exact = is_first | is_second
    out[is_first], out[is_second] = values[k - 1][is_first], values[k][is_second]
    is_between: Bool = (x > 0) & (x < 1) & (span <= max_gap)
    out[~(is_exact | is_between)] = np.nan
    return np.asarray(out)


@dataclass(frozen=True)
class Past:
    """Memories of signals that are inputs of a decoder.

    Attributes:
        moved: Time constants of the memories h, s.
        worked: Time constants of the memories q, s.
    """

    moved: tuple[float, ...] = ()
    worked: tuple[float, ...] = ()

    @property
    def count(self) -> int:
        """Number of memories of each signal."""
        return len(self.moved) + len(self.worked)

    def __call__(self, time: Float, signals: Float) -> Float:
        """Add the memories to signals.

        The signals are assumed to have been constant before the first sample, and linear over gaps.

        Args:
            time: Times of the samples (n,), s.
            signals: Signals (n, c).

        Returns:
            Inputs (n, c (1 + count)): the signals, then h of each time constant, then q. NaN where
            a signal is NaN.
        """
        if not self.count:
            return signals
        h, q = _memories(
            np.ascontiguousarray(time, float),
            np.ascontiguousarray(signals, float),
            np.array(self.moved, float),
            np.array(self.worked, float),
        )
        return np.concatenate([signals, h, q], axis=1)


class PastStream:
    """Adds the memories to signals, one sample at a time.

    Args:
        past: The memories.
        channels: Number of signals c.
    """

    def __init__(self, past: Past, channels: int) -> None:
        self._past = past
        self._moved, self._worked = np.array(past.moved), np.array(past.worked)
        self._time = np.nan
        self._since = np.zeros(channels)
        self._last = np.full(channels, np.nan)
        self._m = np.full((len(past.moved), channels), np.nan)
        self._q = np.zeros((len(past.worked), channels))
        self._r = np.full(channels, np.nan)

    def __call__(self, time: float, signals: Float) -> Float:
        """Return the inputs (c (1 + count),) of a sample.

        Args:
            time: Time of the sample, later than that of the last one, s.
            signals: Signals (c,).
        """
        dt = time - self._time if np.isfinite(self._time) else 0.0
        self._time = time
        h, q = _advance(
            dt,
            signals,
            self._since,
            self._last,
            self._m,
            self._q,
            self._r,
            self._moved,
            self._worked,
        )
        return np.concatenate([signals, h, q])

    def rescale(self, scale: Float, shift: Float) -> None:
        """Replace all signals so far by scale * signal + shift, because their reference changed.

        The memories q stay as they are.

        Args:
            scale: Scale of each signal (c,).
            shift: Shift of each signal (c,).
        """
        for state in (self._last, self._m, self._r):
            state[...] = scale * state + shift


@compiled(error_model="numpy")
def _advance(dt, signals, since, last, m, q, r, moved, worked):  # type: ignore[no-untyped-def]
    """Return h and q of a sample, `dt` s after the last one.

    Updates `since` (c,), the time since each signal was last known in s, `last` and `r` (c,), and
    `m` and `q` (k, c).
    """
    c = len(signals)
    h_out, q_out = np.empty(len(moved) * c), np.empty(len(worked) * c)
    for j in range(c):
        now = signals[j]
        since[j] += dt
        if not np.isfinite(now):
            h_out[j::c] = np.nan
            q_out[j::c] = np.nan
            continue
        is_first = not np.isfinite(last[j])
        before = now if is_first else last[j]
        step = 0.0 if is_first else since[j]
        slope = (now - before) / step if step > 0 else 0.0
        for k in range(len(moved)):
            decay = np.exp(-step / moved[k])
            if is_first:
                m[k, j] = before
            # On a straight line, m lags by the slope times T once it has settled.
            lag = slope * moved[k]
            m[k, j] = now - lag + (m[k, j] - before + lag) * decay
            h_out[k * c + j] = now - m[k, j]
        smooth = before if is_first else r[j]
        lag = slope * _SMOOTHING_S
        r[j] = now - lag + (smooth - before + lag) * np.exp(-step / _SMOOTHING_S)
        speed = abs(r[j] - smooth) / step if step > 0 else 0.0
        for k in range(len(worked)):
            decay = np.exp(-step / worked[k])
            q[k, j] = q[k, j] * decay + speed * worked[k] * (1 - decay)
            q_out[k * c + j] = q[k, j]
        last[j], since[j] = now, 0.0
    return h_out, q_out


@compiled(error_model="numpy")
def _memories(time, signals, moved, worked):  # type: ignore[no-untyped-def]
    n, c = signals.shape
    h, q = np.empty((n, len(moved) * c)), np.empty((n, len(worked) * c))
    last, r, since = np.full(c, np.nan), np.full(c, np.nan), np.zeros(c)
    m = np.full((len(moved), c), np.nan)
    w = np.zeros((len(worked), c))
    for i in range(n):
        dt = time[i] - time[i - 1] if i else 0.0
        h[i], q[i] = _advance(dt, signals[i], since, last, m, w, r, moved, worked)
    return h, q
