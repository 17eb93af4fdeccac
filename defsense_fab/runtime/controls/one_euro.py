"""The One Euro filter: smooth while little moves, quick while much does.

Casiez, Roussel, Vogel: 1€ Filter: A Simple Speed-based Low-pass Filter for Noisy Input in
Interactive Systems, CHI 2012. A first-order low pass whose cutoff grows with the speed.
"""

from __future__ import annotations

import math


class OneEuro:
    """Smooths one value. `cutoff` (Hz) is that of a value at rest: less jitter the lower it is;
    `speed` (Hz per unit/s, the paper's beta) is what speed adds to it: less lag the higher it is;
    `slope_cutoff` (Hz) smooths the speed. A cutoff of 0 leaves values as they are."""

    def __init__(self, cutoff: float, speed: float = 0.0, slope_cutoff: float = 1.0) -> None:
        self._cutoff, self._speed, self._slope_cutoff = cutoff, speed, slope_cutoff
        self._time: float | None = None
        self._value = self._slope = 0.0

    def __call__(self, value: float, time: float) -> float:
        """The smoothed value at `time` (s). Where the clock goes back (another board, one that was
        reset) or a value is no number, the filter begins anew."""
        if self._cutoff <= 0 or not math.isfinite(value):
            self._time = None
            return value
        if self._time is None or time < self._time:
            self._time, self._value, self._slope = time, value, 0.0
            return value
        step = time - self._time
        if step > 0:
            slope = (value - self._value) / step
            self._slope += _weight(self._slope_cutoff, step) * (slope - self._slope)
            cutoff = self._cutoff + self._speed * abs(self._slope)
            self._value += _weight(cutoff, step) * (value - self._value)
            self._time = time
        return self._value


def _weight(cutoff: float, step: float) -> float:
    """Of the new value, in a low pass of this cutoff (Hz) and step (s): 1 / (1 + tau / step)."""
    turn = 2 * math.pi * cutoff * step
    return turn / (turn + 1)
