"""Decoders by name, all behind one call."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh

from ..core.arrays import Float, Int
from .ridge import KINDS, LEAST_NOISE, Decoder, fit, noise_on_outputs

# A decoder without features of its own: kernel ridge regression.
#
# Radial basis functions about the training signals, scaled to unit spread; their width and the
# ridge's weight are chosen by cross-validation in contiguous folds. For each width and fold one
# eigendecomposition of the kernel gives the errors of all weights (Hastie, Tibshirani & Friedman,
# The Elements of Statistical Learning, section 5.8): a tenth of the time of a library's search.

# Cross-validation in contiguous folds: neighbouring states are alike, and shuffled folds would
# show a decoder nearly what it is tested on.

FOLDS = 5


def contiguous(count: int, folds: int = FOLDS) -> list[tuple[Int, Int]]:
    """Pairs of training and test indices, each test a run of neighbours."""
    everything = np.arange(count)
    tests = np.array_split(everything, min(folds, count))
    return [(np.setdiff1d(everything, test), test) for test in tests]


_WIDTHS = np.logspace(-2, 0.5, 6)  # gamma of exp(-gamma |a - b|^2), signals of unit spread
_PLAIN = 0.1, 1e-3  # width and weight where states are too few to choose by
_WEIGHTS = np.logspace(-6, 1, 8)  # of the ridge


@dataclass(frozen=True)
class KernelDecoder:
    """outputs (n, o) = sum over the trained signals (t, c) of exp(-gamma |(s - s_t) / scale|^2)
    times weights (t, o), + constant (o,); outputs in mm."""

    trained: Float
    scale: Float
    gamma: float
    alpha: float
    weights: Float
    constant: Float

    def __call__(self, signals: Float) -> Float:
        """(n, o) of signals (n, c)."""
        return np.asarray(self._kernel(signals)[0] @ self.weights + self.constant)

    def to_json(self) -> dict[str, Any]:
        """Its numbers, for `prediction.json`."""
        return {
            "trained": self.trained.tolist(),
            "scale": self.scale.tolist(),
            "gamma": self.gamma,
            "weights": self.weights.tolist(),
            "constant": self.constant.tolist(),
        }

    def noise_variance(self, signals: Float, noise: Float | float) -> Float:
        """Variance (n, o) mm^2 that noise (c,) on the signals (n, c) puts on each output, to first
        order."""
        kernel, apart = self._kernel(signals)
        slopes = -2 * self.gamma * kernel[:, :, None] * apart / self.scale
        return noise_on_outputs(slopes, self.weights, noise)

    def _kernel(self, signals: Float) -> tuple[Float, Float]:
        apart = (signals[:, None] - self.trained) / self.scale
        return np.exp(-self.gamma * (apart**2).sum(2)), apart


def fit_kernel(
    signals: Float, outputs: Float, noise: Float | float, like: KernelDecoder | None = None
) -> KernelDecoder:
    """The decoder for signals (n, c) with noise (c,) and outputs (n, o). The noise is shown to it:
    every state counts several times, moved by the noise in every channel either way. Width and
    weight are those of `like`, if given."""
    n, c = signals.shape
    noise = np.broadcast_to(np.maximum(noise, LEAST_NOISE), (c,))
    if n < FOLDS and like is None:
        like = KernelDecoder(signals, np.ones(c), _PLAIN[0], _PLAIN[1], outputs, outputs.mean(0))
    move = np.sqrt(c) * np.diag(noise)
    moves = np.concatenate([np.zeros((1, c)), move, -move])
    shown = (signals[:, None] + moves).reshape(-1, c)  # state by state: folds stay contiguous
    told = np.repeat(outputs, len(moves), axis=0)
    scale = np.maximum(signals.std(0), noise)
    constant = told.mean(0)
    square = _square(shown / scale)
    if like is None:
        splits = [tuple(_repeat(part, len(moves)) for part in split) for split in contiguous(n)]
        gamma, alpha = _chosen(square, told - constant, splits)
    else:
        gamma, alpha = like.gamma, like.alpha
    normal = np.exp(-gamma * square) + alpha * np.eye(len(square))
    weights = cho_solve(cho_factor(normal), told - constant)
    return KernelDecoder(shown, scale, gamma, alpha, np.asarray(weights), constant)


def _square(points: Float) -> Float:
    """Squared distances (n, n) of points (n, c) from each other."""
    norm = (points**2).sum(1)
    return np.asarray(np.maximum(norm[:, None] + norm - 2 * points @ points.T, 0.0))


def _chosen(square: Float, outputs: Float, splits: list[tuple[Int, ...]]) -> tuple[float, float]:
    """The width and weight with the least error on what is left out, averaged over the splits."""
    errors = np.zeros((len(_WEIGHTS), len(_WIDTHS)))
    for k, gamma in enumerate(_WIDTHS):
        kernel = np.exp(-gamma * square)
        for train, test in splits:
            values, vectors = eigh(kernel[np.ix_(train, train)])
            told = vectors.T @ outputs[train]
            seen = kernel[np.ix_(test, train)] @ vectors
            for a, alpha in enumerate(_WEIGHTS):
                guess = seen @ (told / (np.maximum(values, 0.0) + alpha)[:, None])
                errors[a, k] += ((guess - outputs[test]) ** 2).mean()
    weight, width = np.unravel_index(int(errors.argmin()), errors.shape)
    return float(_WIDTHS[width]), float(_WEIGHTS[weight])


def _repeat(states: Int, times: int) -> Int:
    return np.asarray((states[:, None] * times + np.arange(times)).ravel())


Trained = Decoder | KernelDecoder


def fit_decoder(
    kind: str, signals: Float, outputs: Float, noise: Float | float, like: Trained | None = None
) -> Trained:
    """The decoder of signals (n, c) to outputs (n, o) that expects this noise (c,), or one for all
    signals; a kernel decoder takes its width and weight from `like` in place of choosing them."""
    if kind == "kernel":
        return fit_kernel(
            signals, outputs, noise, like if isinstance(like, KernelDecoder) else None
        )
    return fit(KINDS[kind](signals.shape[1]), signals, outputs, noise)
