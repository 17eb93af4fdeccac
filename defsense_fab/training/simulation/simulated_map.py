"""The simulation's map behind a memory that was fitted to pictures, and its errors on folds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...decoding.input_features import InputDecoder
from ...decoding.past import Past
from ...decoding.shared_memory import SharedMemory
from .memory_fit import fit_memory


@dataclass(frozen=True)
class SimulatedMap:
    """Of displacements: fitted to all pictures, and without each fold (k,); root mean squared
    errors (k,) mm on the folds left out."""

    whole: SharedMemory
    folds: tuple[SharedMemory, ...]
    errors: Float

    @staticmethod
    def fitted(
        decoder: InputDecoder, past: Past, inputs: Float, outputs: Float, weights: Float, fold: Int
    ) -> SimulatedMap:
        """To inputs (t, d) that see the `past` and outputs (t, m, 3) mm with weights (t, m), zero
        where one is not known, in folds (t,)."""
        known = weights > 0
        filled = np.where(known[..., None], outputs, 0.0)
        whole = fit_memory(decoder, past, inputs, filled, known)
        folds, errors = [], []
        for k in range(int(fold.max()) + 1):
            test = fold == k
            found = fit_memory(decoder, past, inputs[~test], filled[~test], known[~test], whole)
            off = found(inputs[test]).reshape(-1, *outputs.shape[1:]) - filled[test]
            w = weights[test]
            errors.append(np.sqrt((w * (off**2).sum(2)).sum() / max(float(w.sum()), 1e-300)))
            folds.append(found)
        return SimulatedMap(whole, tuple(folds), np.array(errors))

    def map(self, without: int | None = None) -> SharedMemory:
        """Fitted to all, or without a fold."""
        return self.whole if without is None else self.folds[without]
