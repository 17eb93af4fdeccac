"""Round ends and ticks of color bars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....core.arrays import Float

_TICKS = 7  # at most about so many between the ends
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # times a power of ten
_MIN_WIDTH = 1e-6  # of a range
_NEGLIGIBLE = 0.02  # of the width: a range does not reach beyond zero for less
_OUTSIDE_PERCENT = 0.5  # of the numbers below a range, and above it, if they are outliers
_OUTLIER_FACTOR = 1.6  # by which numbers widen a range if they are outliers


@dataclass(frozen=True)
class ColorRange:
    """A range of numbers with round ends.

    Attributes:
        low: Lower end, a multiple of `step`.
        high: Upper end, a multiple of `step`.
        step: Distance of ticks.
    """

    low: float
    high: float
    step: float


def round_range(low: float, high: float, *, has_zero: bool = True) -> ColorRange:
    """Return the smallest range with round ends around two numbers.

    Args:
        low: Smallest number.
        high: Largest number.
        has_zero: Whether the range must contain zero.
    """
    if not (np.isfinite(low) and np.isfinite(high)):
        low, high = 0.0, 1.0
    if has_zero:
        low, high = min(low, 0.0), max(high, 0.0)
        low = 0.0 if -low < _NEGLIGIBLE * high else low
        high = 0.0 if high < _NEGLIGIBLE * -low else high
    width = max(high - low, _MIN_WIDTH)
    power = 10.0 ** np.floor(np.log10(width / _TICKS))
    step = float(next(s for s in _STEPS if s * power >= width / _TICKS * (1 - 1e-9)) * power)
    first, last = np.floor(low / step + 1e-6), np.ceil(high / step - 1e-6)
    return ColorRange(float(first * step), float(max(last, first + 1) * step), step)


def range_of(numbers: Float, *, has_zero: bool = True) -> ColorRange:
    """Return a range with round ends that contains the known numbers, or 99 % of them.

    Corners of a body have large strains; a range does not contain them if they would widen it.
    """
    known = numbers[np.isfinite(numbers)]
    if not len(known):
        return round_range(0.0, 1.0)
    low, high = np.percentile(known, [_OUTSIDE_PERCENT, 100 - _OUTSIDE_PERCENT])
    if np.ptp(known) <= _OUTLIER_FACTOR * (high - low):
        low, high = known.min(), known.max()
    return round_range(float(low), float(high), has_zero=has_zero)
