"""How the device's clock and the host's go together: offset, drift and delay of arrival.

Frames are late by what buffers and schedulers add, never early. So the line that relates the clocks
runs below all arrivals, as close to them as can be: the edge of their lower convex hull at the mean
time, which solves that linear program (Moon, Skelly & Towsley 1999).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

# The times at which a camera took its frames, from stamps that are late by some ms.
#
# A camera that runs freely takes frames at even steps of its own clock; what computers add on the way
# is never negative. Frames are numbered, and the line of number and stamp runs below all stamps.

_ABOUT = 0.06  # of the period, by which the median step may be off
_SOME = 2000  # frames by which a period is found
_FIRST = 64  # frames that are numbered by their period alone
_SAME = 3  # frames that may seem to be the next one, among a hundred two more: so late they came
_BLOCK = 40  # frames among which one is expected almost in time
_NEAR = 0.1  # periods by which that one is late at most
_SPREAD = 0.6  # periods by which nine of ten are late at most
_BACK = 0.05  # periods that a stamp may be before its time
_EARLY = 0.03  # periods before the earliest fiftieth of the stamps: misnumbered
_MIDDLE = 0.33  # periods by which the median of any _BLOCK frames is late at most: the rate is one
_APART = 0.3  # periods, of the median step of those from whole ones
_STRAY = 0.01  # of the frames, that may seem to come before their time
_ONSET = 0.4  # periods within which most stamps are


@dataclass(frozen=True)
class FrameTimes:
    """`time` (t,) s of frames; whether they were found `even`, otherwise they are the stamps
    themselves; `late` s, by which stamps were later in the median."""

    time: Float
    even: bool
    late: float


def even_frame_times(stamp: Float) -> FrameTimes:
    """Of stamps (t,) s that do not go back. Frames may be missing."""
    as_is = FrameTimes(stamp, False, 0.0)
    step = np.diff(stamp)
    if len(stamp) < _BLOCK or not (step > 0).any():
        return as_is
    n, line, first = min(_FIRST, len(stamp)), np.zeros(0), float(stamp[0])
    period, reach = float(np.median(step[step > 0])), _ABOUT
    while True:
        period = _period(stamp[:n] - first, period, reach)
        for _ in range(3):
            place = (stamp[:n] - first) / period
            number = _number(place)
            if n - len(np.unique(number)) > _SAME + 0.02 * n:
                return as_is
            number = _in_order(number)
            x = number - number[0]
            rest = stamp[:n] - np.polyval(np.polyfit(x, stamp[:n], 1), x)
            # One that came so late that it seems the next one's would bend the line.
            fair = rest >= np.quantile(rest, 0.02) - _EARLY * period
            clocks = fit_clocks(number[fair], stamp[:n][fair])
            first, period = clocks.offset, 1 + clocks.drift
        line = first + period * number
        if n == len(stamp):
            break
        n = min(2 * n, len(stamp))
        reach = 1 / n  # by which the last of them would be a frame off
    late = stamp - line
    parts = np.array_split(late, max(len(late) // _BLOCK, 1))
    worst = max(float(part.min()) for part in parts)
    # A camera that changes its rate, as where it exposes for longer, is not even.
    ends = (late[:_BLOCK], late[-_BLOCK:])
    middle = max(float(np.median(part)) for part in (*parts, *ends))
    step = np.diff(stamp) / period
    usual = [float(np.median(p)) for p in (*np.array_split(step, len(parts)), step[-_BLOCK:])]
    apart = max(abs(s - round(s)) for s in usual)
    early = (late < -_NEAR * period).sum() > _STRAY * len(late)
    if (
        worst > _NEAR * period
        or middle > _MIDDLE * period
        or apart > _APART
        or np.quantile(late, 0.9) > _SPREAD * period
        or early
    ):
        return as_is
    return FrameTimes(line, True, float(np.median(late)))


def _period(place: Float, about: float, reach: float) -> float:
    """At which the fractions of some stamps, in periods, are most alike."""
    place = place[:: max(len(place) // _SOME, 1)]
    periods = about * np.linspace(1 - reach, 1 + reach, 241)
    turns = [abs(np.exp(2j * np.pi * place / p).mean()) for p in periods]
    return float(periods[int(np.argmax(turns))])


def _in_order(number: Float) -> Float:
    """Numbers that increase: a frame that came more than a period late seems to be the next one."""
    x = np.arange(len(number))
    return np.asarray(np.minimum.accumulate((number - x)[::-1])[::-1] + x)


def _number(place: Float) -> Float:
    """Whole numbers of frames from their places, in periods, late by less than one: most are by
    little, so that fractions begin where many follow and few precede, on a circle."""
    fraction = np.sort(place % 1)
    around = np.concatenate([fraction - 1, fraction, fraction + 1])
    here, after, before = (
        np.searchsorted(around, fraction + d) for d in (0.0, _ONSET, -_ONSET / 2)
    )
    edge = fraction[int(((after - here) - 2 * (here - before)).argmax())]
    return np.asarray(np.floor(place - edge + _BACK))


@dataclass(frozen=True)
class Clocks:
    """host = offset + (1 + drift) device, s; `delay`, the median time by which frames arrived later
    than the earliest ones, s."""

    offset: float
    drift: float
    delay: float

    def to_host(self, device: Float) -> Float:
        """The host's time, s, at device times, s."""
        return np.asarray(self.offset + (1 + self.drift) * np.asarray(device))


def fit_clocks(device: Float, host: Float) -> Clocks:
    """From the times (t,) s of both clocks at which frames were sent and arrived; from fewer than
    two different ones no drift."""
    start, first = float(device[0]), float(host[0])
    x, y = device - start, host - first - (device - start)  # the drift alone keeps its digits
    if np.ptp(x) <= 0:
        offset = float((host - device).min())
        return Clocks(offset, 0.0, float(np.median(host - device) - offset))
    hull: list[int] = []
    for i in np.lexsort((y, x)):
        while len(hull) > 1 and _turns_right(x, y, hull[-2], hull[-1], int(i)):
            hull.pop()
        if not hull or x[i] > x[hull[-1]]:
            hull.append(int(i))
    k = int(np.clip(np.searchsorted(x[hull], x.mean()), 1, len(hull) - 1))
    a, b = hull[k - 1], hull[k]
    drift = float((y[b] - y[a]) / (x[b] - x[a]))
    offset = float(y[a] - drift * x[a])
    late = y - (offset + drift * x)
    return Clocks(first + offset - (1 + drift) * start, drift, float(np.median(late)))


def _turns_right(x: Float, y: Float, a: int, b: int, c: int) -> bool:
    return bool((x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a]) <= 0)
