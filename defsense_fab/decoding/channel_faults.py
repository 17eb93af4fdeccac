"""What a torn, shorted, stuck or loose cord looks like in its signal.

Every limit is of what the channel did while it was trained, so a cord that ranges widely is not
called torn, nor one of a coarse converter stuck.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float

TORN, SHORTED, STUCK, LOOSE = "torn", "shorted", "stuck", "loose"


@dataclass(frozen=True)
class FaultLimits:
    """Of c channels: signals (R - R0)/R0 above `high` (c,) or below `low` (c,) are no strain; a
    channel that stays exactly the same for longer than `still` (c,) s while another moves by more
    than `moves` (c,) is stuck; one whose samples jump by more than `jump` (c,) from one to the
    next, root mean square over a second, has a loose contact. One that stays exactly the same for
    longer than `repeats` (c,) s is stuck whatever others do: noise would have changed it (None
    where that is not known)."""

    low: Float
    high: Float
    still: Float
    moves: Float
    jump: Float
    repeats: Float | None = None


@dataclass(frozen=True)
class ChannelFault:
    """What is wrong with a channel, by index, since when, s."""

    channel: int
    kind: str
    since: float


def find_faults(limits: FaultLimits, time: Float, signals: Float) -> list[ChannelFault]:
    """At the end of samples (n, c) of the last seconds, at times (n,) s. NaN and infinity are
    torn."""
    out = []
    for c, s in enumerate(signals.T):
        for kind, now in (
            (TORN, ~(s <= limits.high[c])), (SHORTED, s < limits.low[c]),
            (STUCK, _stuck(limits, time, signals, c)), (LOOSE, _loose(limits, time, s, c)),
        ):  # fmt: skip
            if len(now) and now[-1]:
                began = np.flatnonzero(~now)
                first = int(began[-1]) + 1 if len(began) else 0
                out.append(ChannelFault(c, kind, float(time[first])))
                break
    return out


def unchanged(time: Float, signal: Float) -> Float:
    """For how long (n,) s a signal (n,) has been exactly the same."""
    with np.errstate(invalid="ignore"):  # of an open circuit
        changed = np.append(True, np.diff(signal) != 0)
    since = np.maximum.accumulate(np.where(changed, np.arange(len(signal)), 0))
    return np.asarray(time - time[since])


def second_jumps(time: Float, signal: Float) -> Float:
    """Root mean square (n,) of the differences of a signal (n,), over the second before."""
    with np.errstate(invalid="ignore"):
        square = np.append(0.0, np.diff(signal)) ** 2
    square[~np.isfinite(square)] = 0.0
    total = np.append(0.0, np.cumsum(square))
    first = np.searchsorted(time, time - 1.0)
    last = np.arange(1, len(time) + 1)
    return np.asarray(np.sqrt((total[last] - total[first]) / (last - first)))


def _stuck(limits: FaultLimits, time: Float, signals: Float, channel: int) -> Bool:
    """Since when (n,) a channel has been the same while another has moved."""
    same = unchanged(time, signals[:, channel])
    out = np.zeros(len(time), bool)
    if same[-1] <= limits.still[channel]:
        return out
    since = int(np.searchsorted(time, time[-1] - same[-1]))
    others = np.delete(signals, channel, axis=1)[since:]
    with np.errstate(invalid="ignore"):
        moved = (np.ptp(others, axis=0) > np.delete(limits.moves, channel)).any()
    out[since:] = moved
    return out


def _loose(limits: FaultLimits, time: Float, signal: Float, channel: int) -> Bool:
    return np.asarray(second_jumps(time, signal) > limits.jump[channel])
