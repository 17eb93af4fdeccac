"""Where the inputs of a decoder were in training, to tell later how far they are from there."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...decoding.trained_model import TrainedRange

_LEAST = 1e-3  # of the variance, below which a direction of correlated inputs is noise
_USUAL = 0.99  # of the training's distances lie below one


def trained_range(inputs: Float, signals: Float) -> TrainedRange:
    """Of inputs (t, d), and of the signals (t, c) among them."""
    middle = inputs.mean(0)
    spread = np.maximum(inputs.std(0), 1e-9)
    correlation = np.cov(((inputs - middle) / spread).T).reshape(len(middle), -1)
    values, vectors = np.linalg.eigh(correlation)
    whiten = (vectors / np.sqrt(np.maximum(values, _LEAST))) / spread[:, None]
    apart = np.sqrt((((inputs - middle) @ whiten) ** 2).mean(axis=1))
    usual = max(float(np.quantile(apart, _USUAL)), 1e-9)
    return TrainedRange(middle, whiten, usual, signals.min(0), signals.max(0))
