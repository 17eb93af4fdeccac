"""Find when the read-out board's LED switched, from the flags of its samples.

A sample states whether the LED was on when its conversions started, so one toggle is known only to
within a sample's period. But the firmware toggles on a grid: every N ms, a whole number, of the
clock that stamps the samples, late by up to one pass of its loop (a millisecond of `millis()`, or a
conversion). All toggles of a run together narrow the grid's phase, unless N is a multiple
of the samples' period.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError

#: A period for the firmware's `led N`, if the offset is known to 0.35 s beforehand, as it is from
#: times of arrival (use 953 if it is known to 0.9 s). In 60 s, its toggles fall in steps of at most
#: 1.4 ms on all positions between two frames (15, 24, 25, 29.97, 30, 50 or 60 a second) and between
#: two samples (20, 40, 50, 100 or 200 a second). A period of 1000 does so for none of these.
LED_PERIOD_MS = 383
GRID_TOLERANCE_S = 1.5e-3  # by which a toggle may be off its grid
MAX_SAMPLE_GAP_S = 1.0  # after a longer gap a clock may have jumped
MAX_TOGGLE_STEP = 4.0  # in usual sample steps: a longer step does not locate a toggle


@dataclass(frozen=True)
class LedSchedule:
    """k toggles of the LED.

    Attributes:
        time: Times of the toggles (k,) on the device's clock, s, increasing.
        on: Whether the LED is on (k,) after each toggle.
        slack: Half the width of the interval within which all toggles may be moved together, s.
        start: Time of the first sample, s.
        end: Time of the last sample, s.
    """

    time: Float
    on: Bool
    slack: float
    start: float
    end: float

    def state(self, time: Float) -> Float:
        """Return the LED's state at times (...), s: 1 on, -1 off, 0 unknown."""
        k = np.searchsorted(self.time, time, side="right")
        states = np.concatenate([[not self.on[0]], self.on])
        is_known = (time >= self.start) & (time <= self.end)
        return np.where(is_known, np.where(states[k], 1.0, -1.0), 0.0)


def check_clock(name: str, time: Float, max_gap: float | None = None) -> None:
    """Check that stamps never go back or jump ahead.

    Args:
        name: Name of the clock in messages.
        time: Stamps (t,), s.
        max_gap: Largest step between stamps, s; None for no limit.

    Raises:
        CaptureError: If there are fewer than two stamps, or one is invalid.
    """
    if time.ndim != 1 or len(time) < 2:
        raise CaptureError(
            f"the {name}'s clock has {time.size} stamps",
            code="recording-too-short",
            where="synchronization",
            action="Record longer",
            clock=name,
        )
    if not np.isfinite(time).all():
        k = int(np.argmin(np.isfinite(time)))
        raise CaptureError(
            f"stamp {k} of the {name} is not a finite number",
            code="not-a-number",
            where="synchronization",
            action="Leave the stamp out",
            clock=name,
            index=k,
        )
    step = np.diff(time)
    k = int(step.argmin())
    if step[k] < 0:
        raise CaptureError(
            f"the {name}'s clock goes back at stamp {k + 1}, from {time[k]:.3f} s to"
            f" {time[k + 1]:.3f} s",
            code="clock-goes-back",
            where="synchronization",
            action="Synchronize the parts before and after it separately",
            clock=name,
            index=k + 1,
        )
    k = int(step.argmax())
    if max_gap is not None and step[k] > max_gap:
        raise CaptureError(
            f"the {name}'s clock jumps at stamp {k + 1}, from {time[k]:.3f} s to"
            f" {time[k + 1]:.3f} s",
            code="clock-jumps",
            where="synchronization",
            action="Synchronize the parts before and after it separately",
            clock=name,
            index=k + 1,
        )


def find_schedule(time: Float, led: Bool, conversion: float = 0.0) -> LedSchedule:
    """Find the toggles of the LED from n samples.

    Args:
        time: Times (n,) of the samples, half-way through their conversions, s.
        led: Whether the LED was on (n,).
        conversion: Time that the conversions of a sample take, s.

    Raises:
        CaptureError: If the clock goes back, or the LED never switches.
    """
    check_clock("read-out board", time)
    flag_time = time - conversion / 2
    switches = np.flatnonzero(led[1:] != led[:-1]) + 1
    if not len(switches):
        raise CaptureError(
            f"the read-out board's LED was {'on' if led[0] else 'off'} all the time",
            code="led-never-switches",
            where="synchronization",
            action=f"Let it blink with the command 'led {LED_PERIOD_MS}'",
            is_on=bool(led[0]),
        )
    # A toggle during a gap is known only to within the gap; the grid continues without it.
    step = flag_time[switches] - flag_time[switches - 1]
    switches = switches[step <= MAX_TOGGLE_STEP * np.median(step)]
    low, high, on = flag_time[switches - 1], flag_time[switches], led[switches].astype(bool)
    times: list[Float] = []
    states: list[Bool] = []
    slacks: list[float] = []
    counts: list[int] = []
    first = 0
    while first < len(switches):
        n, grid, phase, slack = _longest_run(low[first:], high[first:], on[first:])
        end = float(high[first + n - 1])
        k = np.arange(round((end - phase) / grid) + 1 if n > 1 else 1)
        times.append(np.asarray(phase + k * grid, float))
        states.append((k % 2 == 0) == on[first])
        slacks.append(slack)
        counts.append(n)
        first += n
    toggles = np.concatenate(times)
    order = np.argsort(toggles, kind="stable")
    return LedSchedule(
        toggles[order],
        np.concatenate(states)[order],
        float(np.average(slacks, weights=counts)),
        float(flag_time[0]),
        float(flag_time[-1]),
    )


def _longest_run(low: Float, high: Float, on: Bool) -> tuple[int, float, float, float]:
    """Find how many toggles from the first on lie on one grid.

    Args:
        low: Earliest time of each toggle (k,), s.
        high: Latest time of each toggle (k,), s.
        on: Whether the LED is on after it (k,).

    Returns:
        The number of toggles, the grid's period, s, the first toggle's time, s, and half the width
        of the interval within which that time may be, s.
    """
    middle = (low + high) / 2
    single = 1, 1.0, float(middle[0]), float(high[0] - low[0]) / 2
    if len(low) < 3:
        return single
    guess = float(np.median(np.diff(middle[: min(len(middle), 12)])))
    # Over the first toggles the period may be wrong by this; later toggles determine it better.
    reach = float(high[0] - low[0]) + 2 * GRID_TOLERANCE_S
    grids = np.arange(max(np.floor((guess - reach) * 1e3), 1), np.ceil((guess + reach) * 1e3) + 1)
    lengths: list[int] = []
    for grid in grids / 1e3:
        k = np.round((middle - middle[0]) / grid).astype(np.int64)
        fits = _fits_grid(low - k * grid, high - k * grid, k, on)
        lengths.append(len(fits) if fits.all() else int(fits.argmin()))
    n = max(lengths)
    if n < 3:
        return single
    candidates = []
    for grid in grids[np.array(lengths) == n] / 1e3:
        k = np.round((middle[:n] - middle[0]) / grid)
        a, b = float((low[:n] - k * grid).max()), float((high[:n] - k * grid).min())
        candidates.append((abs(min(b - a, 0.0)), grid, (a + b) / 2, max(b - a, 0.0) / 2, k[-1]))
    possible_grids = [c[1] for c in candidates]
    candidates.sort(key=lambda c: (c[0], abs(c[1] - (middle[n - 1] - middle[0]) / c[4])))
    _, grid, phase, slack, count = candidates[0]
    grid_slack = (max(possible_grids) - min(possible_grids)) * count / 4
    return n, float(grid), float(phase), slack + float(grid_slack)


def _fits_grid(low: Float, high: Float, k: Int, on: Bool) -> Bool:
    """Return for each toggle whether all up to it have a phase in common."""
    width = np.maximum.accumulate(low) - np.minimum.accumulate(high)
    alternates = (k % 2 == 0) == (on == on[0])
    return np.asarray((width <= GRID_TOLERANCE_S) & alternates)
