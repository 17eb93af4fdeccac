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

#: Widths of the radial functions to try, per root of the number of inputs, in their spread.
KERNEL_WIDTHS = (0.5, 1.0, 2.0, 4.0)

_CENTER_COUNT = 200
_MAX_PRODUCTS, _FRAMES_PER_PRODUCT = 200, 5
_MAX_FRAMES = 2000  # frames among which centers are chosen


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
        width: Width of the radial functions of a kernel decoder, one of KERNEL_WIDTHS.
    """

    form: str
    past: Past
    width: float = 1.0

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
        has_products = self.form == QUADRATIC or (
            self.form == KERNEL and has_few_products(channels, len(inputs))
        )
        products = all_products(channels) if has_products else no_products()
        if self.form == KERNEL:
            return InputFeatures(d, products, *_choose_centers(inputs, self.width))
        return InputFeatures(d, products, np.zeros((0, channels)), np.ones(channels))


def has_few_products(channels: int, frames: int) -> bool:
    """Return whether the products of all pairs of signals have few enough coefficients to try."""
    return channels * (channels + 1) // 2 <= min(_MAX_PRODUCTS, frames // _FRAMES_PER_PRODUCT)


def _choose_centers(inputs: Float, width: float) -> tuple[Float, Float]:
    """Return centers (k, d) spread over the inputs (t, d), and the functions' scale (d,).

    Each center is the frame farthest from those chosen before, in units of each input's spread.
    """
    spread = np.maximum(inputs.std(0), 1e-9)
    x = inputs[:: max(len(inputs) // _MAX_FRAMES, 1)] / spread
    chosen = [int(((x - x.mean(0)) ** 2).sum(axis=1).argmax())]
    distance = np.full(len(x), np.inf)
    while len(chosen) < min(_CENTER_COUNT, len(x)):
        distance = np.minimum(distance, ((x - x[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(distance.argmax()))
    return x[chosen] * spread, width * np.sqrt(inputs.shape[1]) * spread
