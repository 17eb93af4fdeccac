"""When the read-out board's LED switched, from the flags of its samples.

A sample says whether the LED was on when its conversions began, so that one toggle is known only
to within a sample's period. The firmware toggles on a grid, though: every N ms, whole ones, of the
clock that stamps the samples, late by what the loop takes (a millisecond of `millis()`, a
conversion). All toggles of a run together narrow the grid's phase down, the more so where N does
not go into samples' periods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError

#: A period for the firmware's `led N`, ms, where the offset is known beforehand to 0.35 s, as by
#: times of arrival (953 where it is known to 0.9 s). With 60 s of it, toggles fall in steps of
#: 1.4 ms and less on all places between two frames (15, 24, 25, 29.97, 30, 50, 60 a second) and
#: between two samples (20, 40, 50, 100, 200 a second). 1000 does so nowhere.
LED_PERIOD = 383
_LATE = 1.5e-3  # s by which a toggle may be off its grid
#: s without samples, after which a clock may have jumped.
PAUSE = 1.0
_WIDE = 4.0  # of the usual step between samples at a toggle


@dataclass(frozen=True)
class LedSchedule:
    """k toggles: `time` (k,) s of the device's clock, increasing; whether the LED is `on` (k,) from
    then; `slack` s, half the width within which all of them may be moved together; `period` s of
    the grid, 0 without one. The first and last sample are at `start` and `end` s."""

    time: Float
    on: Bool
    slack: float
    period: float
    start: float
    end: float

    def state(self, time: Float) -> Float:
        """1 where the LED is on at the times (...), -1 where off, 0 where not known."""
        k = np.searchsorted(self.time, time, side="right")
        states = np.concatenate([[not self.on[0]], self.on])
        known = (time >= self.start) & (time <= self.end)
        return np.where(known, np.where(states[k], 1.0, -1.0), 0.0)


def check_clock(name: str, time: Float, gap: float | None = None) -> None:
    """Of stamps (t,) s that must not go back, nor on by more than `gap` s. Raises CaptureError."""
    if time.ndim != 1 or len(time) < 2:
        raise CaptureError(
            f"synchronise: the {name}'s clock has {time.size} stamps; record longer",
            code="recording-too-short",
            clock=name,
        )
    if not np.isfinite(time).all():
        k = int(np.argmin(np.isfinite(time)))
        raise CaptureError(
            f"synchronise: stamp {k} of the {name} is no number; leave it out",
            code="not-a-number",
            clock=name,
            index=k,
        )
    step = np.diff(time)
    k = int(step.argmin())
    if step[k] < 0:
        raise CaptureError(
            f"synchronise: the {name}'s clock goes back at {k + 1}, from {time[k]:.3f} s to"
            f" {time[k + 1]:.3f} s; give the parts before and after it one by one",
            code="clock-goes-back",
            clock=name,
            index=k + 1,
        )
    k = int(step.argmax())
    if gap is not None and step[k] > gap:
        raise CaptureError(
            f"synchronise: the {name}'s clock jumps at {k + 1}, from {time[k]:.3f} s to"
            f" {time[k + 1]:.3f} s; give the parts before and after it one by one",
            code="clock-jumps",
            clock=name,
            index=k + 1,
        )


def find_schedule(
    time: Float, led: Bool, conversion: float = 0.0, pause: float | None = PAUSE
) -> LedSchedule:
    """Of samples (n,): their `time` s, half-way through conversions of `conversion` s, and the
    flags `led`. Raises CaptureError for clocks that jump (by more than `pause` s; None: by any
    time), and where the LED never switched."""
    check_clock("read-out board", time, pause)
    began = time - conversion / 2
    at = np.flatnonzero(led[1:] != led[:-1]) + 1
    if not len(at):
        raise CaptureError(
            f"synchronise: the read-out board's LED was {'on' if led[0] else 'off'} all the time;"
            f" let it blink: 'led {LED_PERIOD}'",
            code="led-never-switches",
            is_on=bool(led[0]),
        )
    # A toggle while samples lacked is known to their pause only: the grid goes on without it.
    wide = began[at] - began[at - 1]
    at = at[wide <= _WIDE * np.median(wide)]
    low, high, on = began[at - 1], began[at], led[at].astype(bool)
    times: list[Float] = []
    states: list[Bool] = []
    slacks: list[float] = []
    counts: list[int] = []
    longest, period, first = 0, 0.0, 0
    while first < len(at):
        n, grid, phase, slack = _run(low[first:], high[first:], on[first:])
        last = float(high[first + n - 1])
        k = np.arange(round((last - phase) / grid) + 1 if n > 1 else 1)
        times.append(np.asarray(phase + k * grid, float))
        states.append((k % 2 == 0) == on[first])
        slacks.append(slack)
        counts.append(n)
        if n > longest:
            longest, period = n, grid if n > 2 else 0.0
        first += n
    place = np.concatenate(times)
    order = np.argsort(place, kind="stable")
    return LedSchedule(
        place[order], np.concatenate(states)[order], float(np.average(slacks, weights=counts)),
        period, float(began[0]), float(began[-1]),
    )  # fmt: skip


def _run(low: Float, high: Float, on: Bool) -> tuple[int, float, float, float]:
    """How many toggles, seen between `low` and `high` (k,), go on one grid from the first on; its
    period, the first one's time, and half the width within which that may be, s."""
    middle = (low + high) / 2
    alone = 1, 1.0, float(middle[0]), float(high[0] - low[0]) / 2
    if len(low) < 3:
        return alone
    guess = float(np.median(np.diff(middle[: min(len(middle), 12)])))
    # Over the first toggles the period may be off by this; later ones tell more.
    reach = float(high[0] - low[0]) + 2 * _LATE
    grids = np.arange(max(np.floor((guess - reach) * 1e3), 1), np.ceil((guess + reach) * 1e3) + 1)
    lengths: list[int] = []
    for grid in grids / 1e3:
        k = np.round((middle - middle[0]) / grid).astype(np.int64)
        fits = _fits(low - k * grid, high - k * grid, k, on)
        lengths.append(len(fits) if fits.all() else int(fits.argmin()))
    n = max(lengths)
    if n < 3:
        return alone
    ways = []
    for grid in grids[np.array(lengths) == n] / 1e3:
        k = np.round((middle[:n] - middle[0]) / grid)
        a, b = float((low[:n] - k * grid).max()), float((high[:n] - k * grid).min())
        ways.append((abs(min(b - a, 0.0)), grid, (a + b) / 2, max(b - a, 0.0) / 2, k[-1]))
    grids_left = [w[1] for w in ways]
    ways.sort(key=lambda w: (w[0], abs(w[1] - (middle[n - 1] - middle[0]) / w[4])))
    _, grid, phase, slack, count = ways[0]
    loose = (max(grids_left) - min(grids_left)) * count / 4
    return n, float(grid), float(phase), slack + float(loose)


def _fits(low: Float, high: Float, k: Int, on: Bool) -> Bool:
    """Whether the toggles up to each one have a phase in common."""
    widest = np.maximum.accumulate(low) - np.minimum.accumulate(high)
    turn = (k % 2 == 0) == (on == on[0])
    return np.asarray((widest <= _LATE) & turn)
