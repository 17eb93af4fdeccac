"""One built device of many: its cords as a maker laid them, and its pieces of cord."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...optimize.studies.tolerance_monte_carlo import Tolerances, as_laid
from ...sensing.built_cord import BuiltCord, CordReading
from ...sensing.layout import LayoutRecord
from ..electronics.rubber_cords import RubberPieces, RubberTraits
from ..scenes.assumptions import assume
from .device_fields import DeviceFields

_USUAL = Tolerances()
_FROM = "optimize/studies/tolerance_monte_carlo.py"
_BLOCK = 1024  # moments at once


@dataclass(frozen=True)
class BuildingTraits:
    """What a maker cannot hold."""

    offset: float = assume(
        _USUAL.offset, "placement", "mm", "of a cord from its groove's axis, at most, either way",
        _FROM,
    )  # fmt: skip
    gauge: float = assume(
        _USUAL.gauge, "spread", "1", "gauge factors of pieces, standard deviation", _FROM
    )
    prestretch: float = assume(
        _USUAL.prestretch, "prestretch", "strain", "error of the stretch as a cord is laid,"
        " standard deviation", _FROM,
    )  # fmt: skip
    compression: float = assume(
        _USUAL.compression, "compression", "1", "share that the response of bonded cords lacks when"
        " compressed, at most", _FROM,
    )  # fmt: skip

    @property
    def tolerances(self) -> Tolerances:
        """As the design knows them."""
        return Tolerances(
            offset=self.offset, gauge=self.gauge, prestretch=self.prestretch,
            compression=self.compression,
        )  # fmt: skip


@dataclass(frozen=True)
class BuiltUnit:
    """c cords as they are laid, how each is read, and displacements `moved` of their paths
    (s, p, 3) mm in the states of a device's fields; the pieces of cord."""

    cords: tuple[BuiltCord, ...]
    readings: tuple[CordReading, ...]
    moved: tuple[Float, ...]
    pieces: RubberPieces

    def signals(self, weights: Float) -> Float:
        """(R - R0)/R0 (n, c) of these cords if they had no memory, in mixtures (n, s) of the
        states."""
        out = np.empty((len(weights), len(self.cords)))
        for c, (cord, reading, moved) in enumerate(
            zip(self.cords, self.readings, self.moved, strict=True)
        ):
            flat = moved.reshape(len(moved), -1)
            for k in range(0, len(weights), _BLOCK):
                part = slice(k, k + _BLOCK)
                path = cord.path + (weights[part] @ flat).reshape(-1, *cord.path.shape)
                out[part, c] = reading.signals(cord, path)
        return out


def built_unit(
    device: Device, layout: LayoutRecord, fields: DeviceFields, unit: int,
    building: BuildingTraits, rubber: RubberTraits,
) -> BuiltUnit:  # fmt: skip
    """The device of the number `unit`: another one for each, the same for the same."""
    rng, reading = np.random.default_rng([unit, 71]), CordReading.of(device)
    laid = [as_laid(r.built, reading, rng, building.tolerances) for r in layout.by_channel()]
    cords, readings = tuple(c for c, _ in laid), tuple(r for _, r in laid)
    nominal = np.array([r.resistance(c) for c, r in laid])
    pieces = RubberPieces.draw(rubber, nominal, rng)
    return BuiltUnit(cords, readings, tuple(fields.displacements(c.path) for c in cords), pieces)
