"""Detect torn, shorted, stuck and loose cords by their signals.

Every limit refers to what the channel did in training, so that a cord with a wide range is not
called torn, nor a cord of a coarse converter stuck.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float

TORN, SHORTED, STUCK, LOOSE = "torn", "shorted", "stuck", "loose"
_JUMP_WINDOW_S = 1.0


@dataclass(frozen=True)
class FaultLimits:
    """Limits of c channels.

    Attributes:
        low: Signals below this (c,) are not strain: the cord is shorted.
        high: Signals above this (c,) are not strain: the cord is torn.
        still: A channel whose signal is constant for longer than this (c,), s, while another moves
            is stuck.
        moves: Change (c,) by which the other channel must have moved.
        jump: A channel whose samples change by more than this (c,) from one to the next, root mean
            square over a second, has a loose contact.
        repeats: A channel whose signal is constant for longer than this (c,), s, is stuck, whatever
            the others do, since noise would have changed it. None where that is not known.
    """

    low: Float
    high: Float
    still: Float
    moves: Float
    jump: Float
    repeats: Float | None = None


@dataclass(frozen=True)
class ChannelFault:
    """A fault of a channel.

    Attributes:
        channel: Index of the channel.
        kind: TORN, SHORTED, STUCK or LOOSE.
        since: Time at which it started, s.
    """

    channel: int
    kind: str
    since: float


def find_faults(limits: FaultLimits, time: Float, signals: Float) -> list[ChannelFault]:
    """Find the faults that are present at the last sample.

    Args:
        limits: Limits of the channels.
        time: Times of the samples of the last seconds (n,), s.
        signals: Signals (n, c); NaN and infinity mean torn.

    Returns:
        At most one fault per channel.
    """
    out = []
    for c, s in enumerate(signals.T):
        for kind, is_present in (
            (TORN, ~(s <= limits.high[c])),
            (SHORTED, s < limits.low[c]),
            (STUCK, _is_stuck(limits, time, signals, c)),
            (LOOSE, _is_loose(limits, time, s, c)),
        ):
            if len(is_present) and is_present[-1]:
                absent = np.flatnonzero(~is_present)
                first = int(absent[-1]) + 1 if len(absent) else 0
                out.append(ChannelFault(c, kind, float(time[first])))
                break
    return out


def constant_duration(time: Float, signal: Float) -> Float:
    """Return for how long a signal (n,) has been exactly constant at each time (n,), s."""
    with np.errstate(invalid="ignore"):  # of an open circuit
        changed = np.append(True, np.diff(signal) != 0)
    since = np.maximum.accumulate(np.where(changed, np.arange(len(signal)), 0))
    return np.asarray(time - time[since])


def rms_jumps(time: Float, signal: Float) -> Float:
    """Return the root mean square (n,) of a signal's differences over the second before."""
    with np.errstate(invalid="ignore"):
        square = np.append(0.0, np.diff(signal)) ** 2
    square[~np.isfinite(square)] = 0.0
    total = np.append(0.0, np.cumsum(square))
    first = np.searchsorted(time, time - _JUMP_WINDOW_S)
    last = np.arange(1, len(time) + 1)
    return np.asarray(np.sqrt((total[last] - total[first]) / (last - first)))


def _is_stuck(limits: FaultLimits, time: Float, signals: Float, channel: int) -> Bool:
    """Return whether a channel is constant while another has moved, at each time (n,)."""
    duration = constant_duration(time, signals[:, channel])
    out = np.zeros(len(time), bool)
    if duration[-1] <= limits.still[channel]:
        return out
    since = int(np.searchsorted(time, time[-1] - duration[-1]))
    others = np.delete(signals, channel, axis=1)[since:]
    with np.errstate(invalid="ignore"):
        has_moved = (np.ptp(others, axis=0) > np.delete(limits.moves, channel)).any()
    out[since:] = has_moved
    return out


def _is_loose(limits: FaultLimits, time: Float, signal: Float, channel: int) -> Bool:
    return np.asarray(rms_jumps(time, signal) > limits.jump[channel])
