"""The voltage divider: counts of a converter, resistances, and how finely they are told apart.

A reference resistor lies between the supply and the pin, the cord between the pin and ground. With
N counts at the supply's voltage a cord of R ohm gives c = N R / (R + Rref) counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float
from ..core.errors import CaptureError

#: Counts from either end of the converter's range at which a circuit is shorted or open.
_EDGE = 0.002
#: Preferred values of a decade (IEC 60063, E24).
E24 = (
    1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0,
    3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1,
)  # fmt: skip
_CONVERSION = (0.124e-3, 1.84e-3)  # s, of the converters 0 and 1, with what goes on between two
_INPUTS = 4  # of a chip of converter 1; chips convert at the same time
_MORE_CHIPS = 0.37e-3  # s that every further chip adds to a conversion


@dataclass(frozen=True)
class Dividers:
    """Reference resistors `reference` (c,) ohm, and `full_scale`: counts of one conversion at the
    supply's voltage, (c,) or one for all channels. Raises CaptureError for what cannot be."""

    reference: Float
    full_scale: Float | float

    def __post_init__(self) -> None:
        for name in ("reference", "full_scale"):
            values = np.asarray(getattr(self, name), float)
            if not (np.isfinite(values) & (values > 0)).all():
                raise CaptureError(
                    f"dividers: {name} must be above zero, not {values.tolist()}",
                    code="not-positive",
                    field=name,
                )

    def resistance(self, counts: Float) -> Float:
        """Ohm (..., c) for mean counts (..., c): 0 for a short circuit, inf for an open one, NaN
        where the counts are."""
        share = np.asarray(counts, float) / self.full_scale
        with np.errstate(divide="ignore", invalid="ignore"):
            ohm = self.reference * share / (1 - share)
        ohm = np.where(share <= _EDGE, 0.0, ohm)
        return np.asarray(np.where(share >= 1 - _EDGE, np.inf, ohm))

    def counts(self, resistance: Float) -> Float:
        """Mean counts (..., c) that resistances (..., c) ohm give."""
        return np.asarray(self.full_scale * resistance / (resistance + self.reference))

    def resolution(self, resistance: Float) -> Float:
        """Ohm per count (..., c) at resistances (..., c): (R + Rref)^2 / (N Rref)."""
        total = np.asarray(resistance) + self.reference
        return np.asarray(total**2 / (self.full_scale * self.reference))


def saturated(counts: Float, full_scale: Float | float) -> Bool:
    """Which counts (..., c) lie at an end of the converter's range."""
    share = np.asarray(counts, float) / full_scale
    return np.asarray((share <= _EDGE) | (share >= 1 - _EDGE))


def reference(low: float, high: float) -> float:
    """The E24 resistor (ohm) next to the geometric mean of a range of resistances.

    In a divider that gives the largest swing of voltage over the range: its derivative by the
    reference vanishes where that is sqrt(low * high).
    """
    wanted = float(np.sqrt(low * high))
    decade = 10.0 ** np.floor(np.log10(wanted))
    values = np.array([v * d for d in (decade / 10, decade, decade * 10) for v in E24])
    return float(values[np.abs(np.log(values / wanted)).argmin()])


def measured_reference(counts: Float, known: float, full_scale: Float | float) -> Float:
    """Reference resistors (c,) ohm from mean counts (c,) with a known resistor in the cords' place.
    Raises CaptureError where a channel has none."""
    if saturated(counts, full_scale).any() or not np.isfinite(counts).all():
        bad = np.flatnonzero(saturated(counts, full_scale) | ~np.isfinite(counts))
        raise CaptureError(
            f"channels {', '.join(str(i + 1) for i in bad)} are open or shorted; put the known"
            " resistor in the place of every cord",
            code="channels-unreadable",
            channels=[int(i) + 1 for i in bad],
        )
    return np.asarray(known * (full_scale / counts - 1))


def conversion_time(converter: int, channels: int, averages: int) -> float:
    """How long the conversions of a sample take, s, by what `Info` tells of the read-out board:
    measured with the firmware in simulation (16 MHz), for its `converter` 0 or 1."""
    if converter == 0:
        return _CONVERSION[0] * channels * averages
    chips = -(-channels // _INPUTS)
    each = _CONVERSION[1] + _MORE_CHIPS * (chips - 1)
    return each * min(channels, _INPUTS) * averages
