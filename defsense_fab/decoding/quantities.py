"""Quantities of models that are not of a device: what channels read, and what targets are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float, Int

#: Unit of channels that are given as relative changes of their resistance.
RELATIVE = "(R - R0)/R0"
#: Unit of large numbers without a unit.
COUNTS = "counts"


@dataclass(frozen=True)
class Readings:
    """What the channels of a sensor read.

    Signals are (reading - reference) / scale. The reference is fixed; it is no rest.

    Attributes:
        units: Unit of each channel (c,), such as "ohm", "pF", "V", "counts" or "(R - R0)/R0".
        reference: Reading of each channel (c,) at which its signal is 0.
        scale: Change of each channel's reading (c,) that is a signal of 1.
        meaning: Where the reference is from, in words.
    """

    units: tuple[str, ...]
    reference: Float
    scale: Float
    meaning: str

    def signals(self, values: Float) -> Float:
        """Return the signals (..., c) of readings (..., c); NaN stays NaN."""
        return np.asarray((values - self.reference) / self.scale)

    def select(self, index: Sequence[int]) -> Readings:
        """Return some of the channels, by index."""
        i = list(index)
        return Readings(
            tuple(self.units[k] for k in i), self.reference[i], self.scale[i], self.meaning
        )


@dataclass(frozen=True)
class Targets:
    """What a model decodes, in place of the positions of tags.

    Attributes:
        names: Name of each target (m,).
        units: Unit of each target (m,), such as "mm", "deg" or "N"; empty if unknown.
        axes: Numbers of a target: 3 for positions, 1 for scalars.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    axes: int

    @property
    def distinct_units(self) -> tuple[str, ...]:
        """The units, each once, in the order of the targets."""
        return tuple(dict.fromkeys(self.units))

    def of_unit(self, unit: str) -> Bool:
        """Return which targets (m,) have a unit."""
        return np.array([u == unit for u in self.units])

    def select(self, which: Bool | Int) -> Targets:
        """Return the targets of a mask (m,) or of some indices."""
        kept = np.arange(len(self.names))[which].tolist()
        return Targets(
            tuple(self.names[k] for k in kept), tuple(self.units[k] for k in kept), self.axes
        )

    def columns(self) -> tuple[str, ...]:
        """Return a name with unit for each number of the targets, such as `angle_deg`."""
        axes = ("",) if self.axes == 1 else ("_x", "_y", "_z")
        return tuple(
            f"{name}{axis}{f'_{unit}' if unit else ''}"
            for name, unit in zip(self.names, self.units, strict=True)
            for axis in axes
        )


#: Targets of models of devices: positions of tags.
MARKER_UNIT = "mm"
