"""One built device of many: the cords as its maker built them, and the pieces of cord."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...optimization.studies.tolerance_monte_carlo import Tolerances, sample_built_cord
from ...sensing.built_cord import BuiltCord, CordReading
from ...store.layout import LayoutRecord
from ..electronics.rubber_cords import RubberPieces, RubberTraits
from ..scenes.assumptions import assume
from .device_fields import DeviceFields

_DEFAULT = Tolerances()
_SOURCE = "optimization/studies/tolerance_monte_carlo.py"
BLOCK_FRAMES = 1024  # frames evaluated at once
UNIT_SEED = 71  # combined with the number of the unit


@dataclass(frozen=True)
class BuildingTraits:
    """Assumptions on the tolerances of a maker.

    Attributes:
        offset: Largest distance of a cord from the axis of its groove, mm.
        gauge: Standard deviation of the gauge factors of pieces of cord, relative.
        ends: Standard deviation of the loose length of a held cord between its ends, mm.
        compression: Largest share that the response of bonded cords lacks when compressed.
    """

    offset: float = assume(
        _DEFAULT.offset,
        "placement",
        "mm",
        "largest distance of a cord from the axis of its groove, either way",
        _SOURCE,
    )
    gauge: float = assume(
        _DEFAULT.gauge,
        "spread",
        "1",
        "gauge factors of pieces, standard deviation",
        f"{_SOURCE}; for printed traces data/traces.csv",
    )
    ends: float = assume(
        _DEFAULT.ends,
        "prestretch",
        "mm",
        "error of the length of a held cord between its ends, standard deviation",
        _SOURCE,
    )
    compression: float = assume(
        _DEFAULT.compression,
        "compression",
        "1",
        "largest share that the response of bonded cords lacks when compressed",
        _SOURCE,
    )

    @property
    def tolerances(self) -> Tolerances:
        """The same numbers as the design uses them."""
        return Tolerances(
            offset=self.offset,
            gauge=self.gauge,
            ends=self.ends,
            compression=self.compression,
        )


@dataclass(frozen=True)
class BuiltUnit:
    """A built device with c cords.

    Attributes:
        cords: The cords as they were built.
        readings: How each cord is read.
        displacements: For each cord, the displacements (s, p, 3) mm of its path in the states of
            the device's fields.
        pieces: The pieces of cord.
    """

    cords: tuple[BuiltCord, ...]
    readings: tuple[CordReading, ...]
    displacements: tuple[Float, ...]
    pieces: RubberPieces

    def signals(self, weights: Float) -> Float:
        """Return the signals (R - R0)/R0 (n, c) that the cords would have without memory.

        Args:
            weights: Weights (n, s) of the states.
        """
        signals = np.empty((len(weights), len(self.cords)))
        cords = zip(self.cords, self.readings, self.displacements, strict=True)
        for c, (cord, reading, displacements) in enumerate(cords):
            flat = displacements.reshape(len(displacements), -1)
            for k in range(0, len(weights), BLOCK_FRAMES):
                block = slice(k, k + BLOCK_FRAMES)
                path = cord.path + (weights[block] @ flat).reshape(-1, *cord.path.shape)
                signals[block, c] = reading.signals(cord, path)
        return signals


def build_unit(
    device: Device,
    layout: LayoutRecord,
    fields: DeviceFields,
    unit: int,
    building: BuildingTraits,
    rubber: RubberTraits,
) -> BuiltUnit:
    """Build a device with random errors.

    Args:
        device: The device.
        layout: The layout of its cords.
        fields: Its displacement fields.
        unit: Number of the built device: each number gives another one, always the same.
        building: Tolerances of the maker.
        rubber: Properties of the cord.
    """
    rng, reading = np.random.default_rng([unit, UNIT_SEED]), CordReading.from_device(device)
    tolerances = building.tolerances
    built = [sample_built_cord(r.built, reading, rng, tolerances) for r in layout.by_channel()]
    cords, readings = tuple(c for c, _ in built), tuple(r for _, r in built)
    nominal = np.array([r.resistance(c) for c, r in built])
    pieces = RubberPieces.draw(rubber, nominal, rng)
    return BuiltUnit(cords, readings, tuple(fields.displacements(c.path) for c in cords), pieces)
