"""What the simulation says of a device, as something to train on beside what was measured.

Ridge towards the simulated map: its states count as pictures, all together as much as so many
measured ones; how many is chosen by the folds, none among the choices. A built device's channels
have gains of their own, which a few pictures tell: these are found first (`channel_gains.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...decoding.past import Past
from ..ridge.weighted_ridge import Sums, Whitened, sums

#: Measured pictures that all of the simulated states together may count as.
WORTHS = (0.0, 3.0, 30.0, 300.0, 3000.0)


@dataclass(frozen=True)
class Prior:
    """Simulated states by their `names` (s,), rest first: signals (s, c) of the device's channels,
    and displacements (s, m, 3) mm of its markers."""

    names: tuple[str, ...]
    signals: Float
    displacements: Float

    def __post_init__(self) -> None:
        s = len(self.names)
        if len(self.signals) != s or len(self.displacements) != s or s < 2:
            raise TrainingError(
                f"the simulation has {s} states, signals {self.signals.shape} and displacements"
                f" {self.displacements.shape}; build the device again"
            )

    def inputs(self, past: Past, channels: list[int]) -> Float:
        """What a decoder sees (s, d) in states that were kept for long: nothing has moved."""
        c = len(channels)
        return np.concatenate(
            [self.signals[:, channels], np.zeros((len(self.names), c * past.count))], axis=1
        )

    def sums(self, phi: Float, whitened: Whitened) -> Sums:
        """Of their features (s, f), with weights that add up to one."""
        s, m = self.displacements.shape[:2]
        weights = np.full((s, m), 1 / s)
        return sums(whitened(phi), self.displacements, weights, np.zeros(s, np.int64))
