"""The decoders that training tries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...decoding.input_decoder import InputFeatures, all_products, no_products
from ...decoding.signal_history import Past

AFFINE, QUADRATIC, KERNEL = "affine", "quadratic", "kernel"
#: From simple to rich; of those that are as good, the first is taken.
FORMS = (AFFINE, QUADRATIC, KERNEL)
MEMORY, WORK, SIMULATED = "memory", "work", "simulated"
_CENTERS = 40
_DRAWN = 2000  # pictures among which centers are chosen
_WIDTH = 1.5  # of the functions, in the mean distance from a center to its nearest


def form_of(kind: str) -> str:
    """Which of FORMS a decoder has, by the name of its kind; SIMULATED where it starts from the
    simulation's own map, and the kind itself where it names none."""
    parts = kind.split(" + ")
    return SIMULATED if SIMULATED in parts else next((f for f in FORMS if f in parts), kind)


@dataclass(frozen=True)
class Candidate:
    """A form of decoder, and the past that it sees."""

    form: str
    past: Past

    @property
    def name(self) -> str:
        """affine, quadratic + memory, ..."""
        memory = [MEMORY] * bool(self.past.moved) + [WORK] * bool(self.past.worked)
        return " + ".join([self.form, *memory])

    def features(self, inputs: Float, channels: int) -> InputFeatures:
        """For inputs (t, d) to be trained on, the first of which are the signals of so many
        channels."""
        d = inputs.shape[1]
        products = no_products() if self.form == AFFINE else all_products(channels)
        centers, scale = np.zeros((0, channels)), np.ones(channels)
        if self.form == KERNEL:
            centers, scale = _centers(inputs[:, :channels])
        return InputFeatures(d, products, centers, scale)


def _centers(signals: Float) -> tuple[Float, Float]:
    """Centers (k, c), spread over the signals (t, c), and the functions' scale (c,)."""
    spread = np.maximum(signals.std(0), 1e-9)
    x = signals[:: max(len(signals) // _DRAWN, 1)] / spread
    chosen = [int(np.linalg.norm(x - x.mean(0), axis=1).argmax())]
    apart = np.full(len(x), np.inf)
    while len(chosen) < min(_CENTERS, len(x)):
        apart = np.minimum(apart, np.linalg.norm(x - x[chosen[-1]], axis=1))
        chosen.append(int(apart.argmax()))
    centers = x[chosen]
    gaps = np.linalg.norm(centers[:, None] - centers, axis=2)
    np.fill_diagonal(gaps, np.inf)
    width = _WIDTH * float(gaps.min(1).mean()) * np.sqrt(signals.shape[1])
    return centers * spread, width * spread
