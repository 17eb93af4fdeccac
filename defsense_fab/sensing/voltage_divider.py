"""Voltage dividers: counts of a converter, resistances, and the resolution of readings.

A reference resistor connects the supply and the pin, the cord connects the pin and ground. With N
counts at the supply's voltage, a cord of R ohm gives c = N R / (R + Rref) counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta

from ..core.arrays import Bool, Float
from ..core.device.boards import ADS1115_INPUTS
from ..core.errors import CaptureError

#: Reference resistors of voltage dividers whose resistors are not known, ohm.
REFERENCE_OHM = 2200.0
#: A resistance in an options record, ohm.
Resistance = Annotated[float, Meta(ge=1e-3, le=1e9)]
#: Share of the converter's range, at either end, in which a circuit is shorted or open.
_SATURATION_MARGIN = 0.002
#: Preferred values of a decade (IEC 60063, E24).
E24 = (
    *(1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0),
    *(3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1),
)
#: Time of a conversion by the converters 0 and 1, including the work between two, s. Measured with
#: the firmware in simulation (16 MHz).
_CONVERSION_S = (0.124e-3, 1.84e-3)
_ADDED_CHIP_S = 0.37e-3  # that every further ADS1115 adds to a conversion, all at the same time


@dataclass(frozen=True)
class Dividers:
    """Voltage dividers of a read-out board's channels.

    Attributes:
        reference: Reference resistors (c,), ohm.
        full_scale: Counts of one conversion at the supply's voltage, (c,) or one for all channels.

    Raises:
        CaptureError: A value is not positive.
    """

    reference: Float
    full_scale: Float | float

    def __post_init__(self) -> None:
        for name in ("reference", "full_scale"):
            values = np.asarray(getattr(self, name), float)
            if not (np.isfinite(values) & (values > 0)).all():
                raise CaptureError(
                    f"{name} is {values.tolist()}",
                    code="not-positive",
                    where="dividers",
                    action="Give values above zero",
                    field=name,
                )

    def resistance(self, counts: Float) -> Float:
        """Convert counts to resistances.

        Args:
            counts: Mean counts (..., c).

        Returns:
            Resistances (..., c), ohm: 0 for a short circuit, inf for an open one, NaN where the
            counts are NaN.
        """
        share = np.asarray(counts, float) / self.full_scale
        with np.errstate(divide="ignore", invalid="ignore"):
            ohm = self.reference * share / (1 - share)
        ohm = np.where(share <= _SATURATION_MARGIN, 0.0, ohm)
        return np.asarray(np.where(share >= 1 - _SATURATION_MARGIN, np.inf, ohm))

    def counts(self, resistance: Float) -> Float:
        """Return the mean counts (..., c) of resistances (..., c) in ohm."""
        return np.asarray(self.full_scale * resistance / (resistance + self.reference))

    def resolution(self, resistance: Float) -> Float:
        """Return the ohms per count (..., c) at resistances (..., c): (R + Rref)^2 / (N Rref)."""
        total = np.asarray(resistance) + self.reference
        return np.asarray(total**2 / (self.full_scale * self.reference))


def reference_resistors(
    values: Sequence[float], channels: int, where: str = "reference"
) -> list[float]:
    """Return one resistance per channel.

    Args:
        values: One resistance for all channels, or one for each, ohm.
        channels: Number of channels.
        where: Name of the argument in an error.

    Returns:
        Resistances (c,), ohm.

    Raises:
        CaptureError: There are neither one nor `channels` values (`resistance-count-differs`).
    """
    if len(values) not in (1, channels):
        raise CaptureError(
            f"{len(values)} resistances are given for {channels} channels",
            code="resistance-count-differs",
            where=where,
            action=f"Give one resistance, or {channels}",
            count=len(values),
        )
    return list(values) * channels if len(values) == 1 else list(values)


def is_saturated(counts: Float, full_scale: Float | float) -> Bool:
    """Return whether counts (..., c) are at an end of the converter's range."""
    share = np.asarray(counts, float) / full_scale
    return np.asarray((share <= _SATURATION_MARGIN) | (share >= 1 - _SATURATION_MARGIN))


def choose_reference(low: float, high: float) -> float:
    """Choose the E24 resistor for a range of resistances.

    It is the one next to the geometric mean, where a divider's voltage changes most over the range:
    the derivative of the change by the reference vanishes at sqrt(low * high).

    Args:
        low: Smallest resistance, ohm.
        high: Largest resistance, ohm.

    Returns:
        The reference resistor, ohm.
    """
    mean = float(np.sqrt(low * high))
    decade = 10.0 ** np.floor(np.log10(mean))
    values = np.array([v * d for d in (decade / 10, decade, decade * 10) for v in E24])
    return float(values[np.abs(np.log(values / mean)).argmin()])


def measure_reference(counts: Float, known: float, full_scale: Float | float) -> Float:
    """Measure the reference resistors with a known resistor in place of each cord.

    Args:
        counts: Mean counts (c,).
        known: The known resistor, ohm.
        full_scale: Counts at the supply's voltage, (c,) or one for all channels.

    Returns:
        The reference resistors (c,), ohm.

    Raises:
        CaptureError: A channel is open or shorted.
    """
    if is_saturated(counts, full_scale).any() or not np.isfinite(counts).all():
        bad = np.flatnonzero(is_saturated(counts, full_scale) | ~np.isfinite(counts))
        channels = [int(i) + 1 for i in bad]
        raise CaptureError(
            f"channels {', '.join(map(str, channels))} are open or shorted",
            code="channels-unreadable",
            where="reference resistors",
            action="Connect the known resistor in place of every cord",
            channels=channels,
        )
    return np.asarray(known * (full_scale / counts - 1))


def conversion_time(converter: int, channels: int, averages: int) -> float:
    """Return how long the conversions of a sample take.

    Args:
        converter: Converter of the read-out board, 0 or 1, as in `Info`.
        channels: Number of channels.
        averages: Conversions per channel.

    Returns:
        Time, s.
    """
    if converter == 0:
        return _CONVERSION_S[0] * channels * averages
    chips = -(-channels // ADS1115_INPUTS)
    each = _CONVERSION_S[1] + _ADDED_CHIP_S * (chips - 1)
    return each * min(channels, ADS1115_INPUTS) * averages
