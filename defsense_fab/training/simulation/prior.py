"""What the simulation says of a device: its states, with the signals and the markers in each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError
from ..ridge.weighted_ridge import Sums, Whitened, sums


@dataclass(frozen=True)
class Prior:
    """Simulated states by their `names` (s,), rest first: signals (s, c) of the device's channels,
    and displacements (s, m, 3) mm of its markers."""

    names: tuple[str, ...]
    signals: Float
    displacements: Float

    def __post_init__(self) -> None:
        s = len(self.names)
        if s < 2:
            raise TrainingError(
                f"the simulation has {s} states; build the device again", code="too-few-states"
            )
        if len(self.signals) != s or len(self.displacements) != s:
            raise TrainingError(
                f"the simulation has {s} states, signals {self.signals.shape} and displacements"
                f" {self.displacements.shape}; build the device again",
                code="shapes-differ",
            )

    def sums(self, phi: Float, whitened: Whitened) -> Sums:
        """Of their features (s, f), with weights that add up to one."""
        s, m = self.displacements.shape[:2]
        weights = np.full((s, m), 1 / s)
        return sums(whitened(phi), self.displacements, weights, np.zeros(s, np.int64))
