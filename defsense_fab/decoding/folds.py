"""Cross-validation in contiguous folds: neighbouring states are alike, and shuffled folds would
show a decoder nearly what it is tested on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from ..core.arrays import Float, Int

FOLDS = 5


def contiguous(count: int, folds: int = FOLDS) -> list[tuple[Int, Int]]:
    """Pairs of training and test indices, each test a run of neighbours."""
    everything = np.arange(count)
    tests = np.array_split(everything, min(folds, count))
    return [(np.setdiff1d(everything, test), test) for test in tests]


class _Decoder(Protocol):
    def __call__(self, signals: Float) -> Float: ...
    def noise_variance(self, signals: Float, noise: float) -> Float: ...


def cross_validated(
    train: Callable[[Float, Float], _Decoder], signals: Float, outputs: Float, noise: float
) -> float:
    """Expected RMSE (mm) under noise of decoders on the states (n, c) that they did not see;
    outputs (n, o) scaled so that a row's squared norm is the state's mean squared marker error."""
    square = 0.0
    for seen, unseen in contiguous(len(signals)):
        decoder = train(signals[seen], outputs[seen])
        square += float(((decoder(signals[unseen]) - outputs[unseen]) ** 2).sum())
        square += float(decoder.noise_variance(signals[unseen], noise).sum())
    return float(np.sqrt(square / len(signals)))
