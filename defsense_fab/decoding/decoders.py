"""Decoders by name, and the one without features of its own: kernel ridge regression.

Kernel ridge regression uses radial basis functions about the training signals, scaled to unit
spread. Cross-validation in contiguous folds chooses their width and the ridge's weight. For each
width and fold, one eigendecomposition of the kernel gives the errors of all weights, in a tenth of
the time of a library's search.

References:
    Hastie, Tibshirani & Friedman, The Elements of Statistical Learning, section 5.8.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from ..core.arrays import Float, Int
from .ridge import FEATURES, MIN_NOISE, Decoder, fit_ridge, noise_on_outputs

FOLDS = 5
_GAMMAS = np.logspace(-2, 0.5, 6)  # of exp(-gamma |a - b|^2), for signals of unit spread
_ALPHAS = np.logspace(-6, 1, 8)  # weights of the ridge
_DEFAULT_GAMMA, _DEFAULT_ALPHA = 0.1, 1e-3  # where there are too few states for a choice


def contiguous_folds(count: int) -> list[tuple[Int, Int]]:
    """Divide samples into contiguous folds for cross-validation.

    Neighboring states are similar: with shuffled folds, a decoder would be tested on almost the
    states that it was trained on.

    Args:
        count: Number of samples.

    Returns:
        Pairs of training and test indices; each test is a run of neighbors.
    """
    everything = np.arange(count)
    tests = np.array_split(everything, min(FOLDS, count))
    return [(np.setdiff1d(everything, test), test) for test in tests]


@dataclass(frozen=True)
class KernelDecoder:
    """Sum over training signals s_t of exp(-gamma |(s - s_t) / scale|^2) weights + constant.

    Attributes:
        trained: Training signals (t, c).
        scale: Scale of each signal (c,).
        gamma: Inverse squared width of the basis functions.
        alpha: Weight of the ridge.
        weights: Weights (t, o), mm.
        constant: Constant (o,), mm.
    """

    trained: Float
    scale: Float
    gamma: float
    alpha: float
    weights: Float
    constant: Float

    def __call__(self, signals: Float) -> Float:
        """Return the outputs (n, o) in mm of signals (n, c)."""
        return np.asarray(self._kernel(signals) @ self.weights + self.constant)

    def to_json(self) -> dict[str, Any]:
        """Return the numbers for `prediction.json`."""
        return {
            "trained": self.trained.tolist(),
            "scale": self.scale.tolist(),
            "gamma": self.gamma,
            "weights": self.weights.tolist(),
            "constant": self.constant.tolist(),
        }

    def noise_variance(self, signals: Float, noise: Float | float) -> Float:
        """Return the variance (n, o) in mm^2 of the outputs, to first order.

        Args:
            signals: Signals (n, c).
            noise: Standard deviations of the signals (c,), or one for all.
        """
        difference = (signals[:, None] - self.trained) / self.scale**2
        slopes = -2 * self.gamma * self._kernel(signals)[:, :, None] * difference
        return noise_on_outputs(slopes, self.weights, noise)

    def _kernel(self, signals: Float) -> Float:
        """Return the kernel (n, t) of signals and training signals."""
        square = cdist(signals / self.scale, self.trained / self.scale, "sqeuclidean")
        return np.asarray(np.exp(-self.gamma * square))


def _fit_kernel(
    signals: Float,
    outputs: Float,
    noise: Float | float,
    like: KernelDecoder | None,
    repeats: Int | None,
) -> KernelDecoder:
    """Fit a kernel decoder; see `fit_decoder`.

    The noise is part of the training: every state counts several times, moved by the noise in every
    channel either way.
    """
    n, c = signals.shape
    counts = np.ones(n, int) if repeats is None else repeats
    noise = np.broadcast_to(np.maximum(noise, MIN_NOISE), (c,))
    if counts.sum() < FOLDS and like is None:
        like = KernelDecoder(
            signals, np.ones(c), _DEFAULT_GAMMA, _DEFAULT_ALPHA, outputs, outputs.mean(0)
        )
    move = np.sqrt(c) * np.diag(noise)
    moves = np.concatenate([np.zeros((1, c)), move, -move])
    samples = (signals[:, None] + moves).reshape(-1, c)  # state by state: folds stay contiguous
    scale = np.maximum(np.repeat(signals, counts, axis=0).std(0), noise)
    constant = np.average(outputs, axis=0, weights=counts)
    targets = np.repeat(outputs - constant, len(moves), axis=0)
    square = _squared_distances(samples / scale)
    if like is None:
        rows = _repeat(np.repeat(np.arange(n), counts), len(moves))
        splits = [
            tuple(_repeat(part, len(moves)) for part in fold)
            for fold in contiguous_folds(int(counts.sum()))
        ]
        gamma, alpha = _choose_hyperparameters(square[np.ix_(rows, rows)], targets[rows], splits)
    else:
        gamma, alpha = like.gamma, like.alpha
    # A sample that counts k times has one weight, the sum of k equal ones, and a k-th of the ridge.
    ridge = alpha / np.repeat(counts, len(moves))
    normal = np.exp(-gamma * square) + np.diag(ridge)
    weights = cho_solve(cho_factor(normal), targets)
    return KernelDecoder(samples, scale, gamma, alpha, np.asarray(weights), constant)


def _squared_distances(points: Float) -> Float:
    """Return the squared distances (n, n) of points (n, c) from each other."""
    norm = (points**2).sum(1)
    return np.asarray(np.maximum(norm[:, None] + norm - 2 * points @ points.T, 0.0))


def _choose_hyperparameters(
    square: Float, outputs: Float, splits: list[tuple[Int, ...]]
) -> tuple[float, float]:
    """Return the gamma and alpha with the lowest test error, averaged over the splits."""
    errors = np.zeros((len(_ALPHAS), len(_GAMMAS)))
    for k, gamma in enumerate(_GAMMAS):
        kernel = np.exp(-gamma * square)
        for train, test in splits:
            values, vectors = np.linalg.eigh(kernel[np.ix_(train, train)])
            projected = vectors.T @ outputs[train]
            basis = kernel[np.ix_(test, train)] @ vectors
            for a, alpha in enumerate(_ALPHAS):
                guess = basis @ (projected / (np.maximum(values, 0.0) + alpha)[:, None])
                errors[a, k] += ((guess - outputs[test]) ** 2).mean()
    best_alpha, best_gamma = np.unravel_index(int(errors.argmin()), errors.shape)
    return float(_GAMMAS[best_gamma]), float(_ALPHAS[best_alpha])


def _repeat(states: Int, times: int) -> Int:
    return np.asarray((states[:, None] * times + np.arange(times)).ravel())


AnyDecoder = Decoder | KernelDecoder


def fit_decoder(
    kind: str,
    signals: Float,
    outputs: Float,
    noise: Float | float,
    like: AnyDecoder | None = None,
    repeats: Int | None = None,
) -> AnyDecoder:
    """Fit a decoder.

    Args:
        kind: "affine", "quadratic" or "kernel".
        signals: Signals (n, c), (R - R0)/R0.
        outputs: Outputs (n, o), mm.
        noise: Standard deviations of the signals that the decoder expects (c,), or one for all.
        like: A kernel decoder whose width and weight are used instead of choosing them.
        repeats: How often each row of signals and outputs counts (n,); once by default.

    Returns:
        The decoder.
    """
    if kind == "kernel":
        like = like if isinstance(like, KernelDecoder) else None
        return _fit_kernel(signals, outputs, noise, like, repeats)
    if repeats is not None:
        signals, outputs = (np.repeat(of, repeats, axis=0) for of in (signals, outputs))
    return fit_ridge(FEATURES[kind](signals.shape[1]), signals, outputs, noise)
