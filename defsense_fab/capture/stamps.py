"""The times at which a camera took its frames, from stamps that are late by some ms.

A camera that runs freely takes frames at even steps of its own clock; what computers add on the way
is never negative. Frames are numbered, and the line of number and stamp runs below all stamps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from .clock import relate

_FIRST = 64  # frames that the median step alone may number
_BLOCK = 40  # frames among which one is expected almost in time
_NEAR = 0.1  # periods by which that one is late at most
_SPREAD = 0.6  # periods by which nine of ten are late at most
_BACK = 0.03  # periods that a stamp may be before its time


@dataclass(frozen=True)
class Steady:
    """`time` (t,) s of frames; whether they were found `even`, otherwise they are the stamps
    themselves; `late` s, by which stamps were later in the median."""

    time: Float
    even: bool
    late: float


def steady(stamp: Float) -> Steady:
    """Of stamps (t,) s that do not go back. Frames may be missing."""
    as_is = Steady(stamp, False, 0.0)
    step = np.diff(stamp)
    if len(stamp) < _BLOCK or not (step > 0).any():
        return as_is
    period, first = float(np.median(step[step > 0])), float(stamp[0])
    n, line = min(_FIRST, len(stamp)), np.zeros(0)
    while True:
        for _ in range(3):
            place = (stamp[:n] - first) / period
            number = _number(place)
            if len(np.unique(number)) < 0.98 * n:
                return as_is
            clocks = relate(number, stamp[:n])
            first, period = clocks.offset, 1 + clocks.drift
        line = first + period * number
        if n == len(stamp):
            break
        n = min(2 * n, len(stamp))
    late = stamp - line
    parts = np.array_split(late, max(len(late) // _BLOCK, 1))
    worst = max(float(part.min()) for part in parts)
    if worst > _NEAR * period or np.quantile(late, 0.9) > _SPREAD * period:
        return as_is
    return Steady(line, True, float(np.median(late)))


def _number(place: Float) -> Float:
    """Whole numbers of frames from their places, in periods, late by less than one: counted from
    the widest gap on the circle of fractions."""
    fraction = np.sort(place % 1)
    gaps = np.diff(np.append(fraction, fraction[0] + 1))
    k = int(gaps.argmax())
    edge = fraction[(k + 1) % len(fraction)] - min(_BACK, gaps[k] / 2)
    return np.asarray(np.floor(place - edge))
