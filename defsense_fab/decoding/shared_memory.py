"""A map of a device without a past, behind signals from which the cords' past is taken out.

All cords of a device are of one rubber: what they remember, they remember alike. So a few numbers
that are shared by all channels, with a gain and an offset of each, bring the signals of built cords
to those of ideal ones, for which a simulation knows the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from .input_features import InputDecoder


@dataclass(frozen=True)
class SharedMemory:
    """u = (s + sum_k moved_k h_k + sum_k worked_k q_k - offset) / gain goes into the `decoder` of c
    signals; h and q (`past.py`) are the memories of the K and Q time constants of the past that the
    inputs are made with; `moved` (K,), `worked` (Q,), `gain` and `offset` (c,)."""

    gain: Float
    offset: Float
    moved: Float
    worked: Float
    decoder: InputDecoder

    def ideal(self, inputs: Float) -> Float:
        """u (t, c) of inputs (t, c (1 + K + Q))."""
        c = len(self.gain)
        shares = np.concatenate([[1.0], self.moved, self.worked])
        s = np.tensordot(inputs.reshape(*inputs.shape[:-1], len(shares), c), shares, (-2, 0))
        return np.asarray((s - self.offset) / self.gain)

    def __call__(self, inputs: Float) -> Float:
        """(t, o) of inputs (t, d)."""
        return self.decoder(self.ideal(inputs))

    def one(self, inputs: Float) -> Float:
        """(o,) of one sample's inputs (d,)."""
        return self.decoder.one(self.ideal(inputs))
