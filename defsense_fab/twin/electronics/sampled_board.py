"""What a read-out board's converter makes of resistances, without its wire: sums of conversions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...sensing.voltage_divider import Dividers
from ..scenes.assumption import assumed

#: Of a converter whose steps cannot be seen.
_FINE = 500_000_000


@dataclass(frozen=True)
class BoardTraits:
    """The read-out board; its clock is `offset` + (1 + `drift`) times the cameras'."""

    steps: bool = assumed(
        True, "quantisation", "", "conversions are whole counts",
        "ATmega328P and ADS1115 (core/device/device.py, CONVERTERS)", off=False,
    )  # fmt: skip
    own_noise: float = assumed(
        0.5, "quantisation", "counts", "noise of a conversion, white, which evens out steps"
    )
    rate: float = assumed(60.0, "read-out board", "Hz", "samples", off=60.0)
    offset: float = assumed(0.35, "read-out board", "s", "its clock against the cameras'", off=0.35)
    drift: float = assumed(
        60e-6, "read-out board", "1", "the same, relative: a ceramic resonator's order", off=60e-6
    )
    sync_error: float = assumed(
        0.003, "sync", "s", "by which the clocks' comparison is off, standard deviation; stated"
    )


@dataclass(frozen=True)
class Converter:
    """`averages` conversions a sample, of `full_scale` counts, with dividers of `reference` (c,)
    ohm."""

    full_scale: int
    averages: int
    reference: Float

    @classmethod
    def of(cls, traits: BoardTraits, full_scale: int, averages: int, reference: Float) -> Converter:
        """The board's, or one without steps."""
        if traits.steps:
            return cls(full_scale, averages, reference)
        return cls(_FINE, 1, reference)

    def sums(self, ohm: Float, own_noise: float, rng: np.random.Generator) -> Int:
        """(n, c) of resistances (n, c) ohm."""
        counts = Dividers(self.reference, self.full_scale).counts(ohm)
        out = np.zeros(counts.shape, np.int64)
        for _ in range(self.averages):
            read = np.rint(counts + own_noise * rng.normal(size=counts.shape))
            out += np.clip(read, 0, self.full_scale).astype(np.int64)
        return out

    def resistances(self, sums: Int) -> Float:
        """Ohm (n, c), as the host has them."""
        return Dividers(self.reference, self.full_scale).resistance(sums / self.averages)
