"""What a decoder knows of the signals' past: how far each has moved of late, and how much.

Rubber cords relax and are stiffer on the way out than back, so the same signal belongs to
different shapes. A cord that is a chain of relaxing elements (generalised Maxwell) is undone by
exponential memories of its own signal. Of each time constant T and each signal s there are

    h = s - m,  m' = (s - m)/T        how far it is from where it was: a rate for short T
    q' = |r'| - q/T                   how much it has moved, either way

with r the signal without what changes within a fifth of a second: noise is no movement. h is exact
for signals that run straight between samples, at any rate of sampling; q is so for r that does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float
from ..core.machine.compiled import compiled

# Values between samples.

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


_SMOOTH = 0.2  # s


@dataclass(frozen=True)
class Past:
    """Time constants, s, of the memories of where signals were (`moved`) and of how much they have
    moved (`worked`)."""

    moved: tuple[float, ...] = ()
    worked: tuple[float, ...] = ()

    @property
    def count(self) -> int:
        """Numbers that are added for each signal."""
        return len(self.moved) + len(self.worked)

    def __call__(self, time: Float, signals: Float) -> Float:
        """Signals (n, c) at times (n,) s and what is known of their past, (n, c (1 + count)): the
        signals, then h of each time constant, then q. Signals are taken to have been for long what
        they are first. NaN is where a signal is; over a gap signals are taken to have gone straight
        from the sample before it to the one after."""
        if not self.count:
            return signals
        h, q = _memories(
            np.ascontiguousarray(time, float), np.ascontiguousarray(signals, float),
            np.array(self.moved, float), np.array(self.worked, float),
        )  # fmt: skip
        return np.concatenate([signals, h, q], axis=1)


class PastStream:
    """The same, a sample at a time, as they come."""

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
        """(c (1 + count),) of the sample (c,) at a time, s, later than the one before."""
        dt = time - self._time if np.isfinite(self._time) else 0.0
        self._time = time
        h, q = _step(
            dt, signals, self._since, self._last, self._m, self._q, self._r, self._moved,
            self._worked,
        )  # fmt: skip
        return np.concatenate([signals, h, q])

    def rescale(self, scale: Float, shift: Float) -> None:
        """Go on as if all signals (c,) so far had been `scale` (c,) times themselves and `shift`
        (c,) more: what they refer to has changed. How much they have moved stays as it was."""
        for kept in (self._last, self._m, self._r):
            kept[...] = scale * kept + shift


@compiled(error_model="numpy")
def _step(past, signals, since, last, m, q, r, moved, worked):  # type: ignore[no-untyped-def]
    """One sample on, `past` s after the one before. Changed are `since` (c,), s since a channel was
    known, `last` and `r` (c,), `m` and `q` (k, c)."""
    c = len(signals)
    h_out, q_out = np.empty(len(moved) * c), np.empty(len(worked) * c)
    for j in range(c):
        now = signals[j]
        since[j] += past
        if not np.isfinite(now):
            h_out[j::c] = np.nan
            q_out[j::c] = np.nan
            continue
        first = not np.isfinite(last[j])
        before = now if first else last[j]
        dt = 0.0 if first else since[j]
        slope = (now - before) / dt if dt > 0 else 0.0
        for k in range(len(moved)):
            keep = np.exp(-dt / moved[k])
            if first:
                m[k, j] = before
            # Of a straight line, m lags by the slope times T once it has settled.
            lag = slope * moved[k]
            m[k, j] = now - lag + (m[k, j] - before + lag) * keep
            h_out[k * c + j] = now - m[k, j]
        smooth = before if first else r[j]
        lag = slope * _SMOOTH
        r[j] = now - lag + (smooth - before + lag) * np.exp(-dt / _SMOOTH)
        moves = abs(r[j] - smooth) / dt if dt > 0 else 0.0
        for k in range(len(worked)):
            keep = np.exp(-dt / worked[k])
            q[k, j] = q[k, j] * keep + moves * worked[k] * (1 - keep)
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
        h[i], q[i] = _step(dt, signals[i], since, last, m, w, r, moved, worked)
    return h, q
