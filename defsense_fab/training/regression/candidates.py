"""Candidate decoders that training compares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np

from ...core.arrays import Float
from ...decoding.input_decoder import InputFeatures, all_products, no_products
from ...decoding.signal_history import Past
from ..options import DecoderForm

#: Forms of decoders, from simple to rich. Of equally good ones, the first is selected.
FORMS: tuple[str, ...] = get_args(DecoderForm)
AFFINE, QUADRATIC, KERNEL = FORMS
MEMORY, WORK, SIMULATED = "memory", "work", "simulated"

_CENTER_COUNT = 40
_MAX_FRAMES = 2000  # frames among which centers are chosen
_WIDTH_RATIO = 1.5  # width of the basis functions over the mean distance to the nearest center


def parse_form(kind: str) -> str:
    """Return the form of a decoder.

    Args:
        kind: Name of the decoder's kind, such as "quadratic + memory".

    Returns:
        One of FORMS; SIMULATED if the decoder starts from the simulation's map; the kind itself if
        it names neither.
    """
    parts = kind.split(" + ")
    return SIMULATED if SIMULATED in parts else next((f for f in FORMS if f in parts), kind)


@dataclass(frozen=True)
class Candidate:
    """A form of decoder with the memory of past signals that it uses.

    Attributes:
        form: One of FORMS.
        past: The memory.
    """

    form: str
    past: Past

    @property
    def name(self) -> str:
        """Name of the kind of decoder, such as "affine" or "quadratic + memory"."""
        memory = [MEMORY] * bool(self.past.moved) + [WORK] * bool(self.past.worked)
        return " + ".join([self.form, *memory])

    def features(self, inputs: Float, channels: int) -> InputFeatures:
        """Choose the features for training.

        Args:
            inputs: Inputs to train on, shape (t, d); the first `channels` are the signals.
            channels: Number of channels.

        Returns:
            The features of such inputs.
        """
        d = inputs.shape[1]
        products = no_products() if self.form == AFFINE else all_products(channels)
        centers, scale = np.zeros((0, channels)), np.ones(channels)
        if self.form == KERNEL:
            centers, scale = _choose_centers(inputs[:, :channels])
        return InputFeatures(d, products, centers, scale)


def _choose_centers(signals: Float) -> tuple[Float, Float]:
    """Return centers (k, c) spread over the signals (t, c), and the functions' scale (c,).

    Each center is the signal farthest from those chosen before.
    """
    spread = np.maximum(signals.std(0), 1e-9)
    x = signals[:: max(len(signals) // _MAX_FRAMES, 1)] / spread
    chosen = [int(np.linalg.norm(x - x.mean(0), axis=1).argmax())]
    distance = np.full(len(x), np.inf)
    while len(chosen) < min(_CENTER_COUNT, len(x)):
        distance = np.minimum(distance, np.linalg.norm(x - x[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    centers = x[chosen]
    gaps = np.linalg.norm(centers[:, None] - centers, axis=2)
    np.fill_diagonal(gaps, np.inf)
    width = _WIDTH_RATIO * float(gaps.min(1).mean()) * np.sqrt(signals.shape[1])
    return centers * spread, width * spread
