"""Errors of ridge regression with one more channel, for thousands of candidates for that channel.

The features of the given channels do not change, so their part of the normal matrix is factorized
once. The features of the new channel (one, or c + 2 with squares and products) border it, and block
elimination leaves a small system for each candidate. The fits equal those of `ridge.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.arrays import Float, Int
from .ridge import FEATURES, Features, regularize

_CANDIDATES_PER_CHUNK = 1000


def unseen_errors(
    kind: str,
    folds: Sequence[tuple[Int, Int]],
    outputs: Float,
    signals: Float,
    noise: Float,
    added: Float,
    added_noise: Float,
) -> Float:
    """Return the expected error on unseen states with each candidate for a further channel.

    Args:
        kind: Kind of ridge decoder, a key of `FEATURES`.
        folds: Pairs of training and test states, by index.
        outputs: Outputs (n, o), scaled so that a row's squared norm is averaged
            (`reduce_outputs`), mm.
        signals: Signals (n, c) of the given channels; c may be 0.
        noise: Their standard deviations (c,).
        added: Signal of each candidate (n, k).
        added_noise: Their standard deviations (k,).

    Returns:
        RMSE with each candidate (k,), mm.
    """
    features = FEATURES[kind](signals.shape[1] + 1)
    square = np.zeros(added.shape[1])
    for first in range(0, len(square), _CANDIDATES_PER_CHUNK):
        part = slice(first, first + _CANDIDATES_PER_CHUNK)
        for train, test in folds:
            square[part] += _squared_errors(
                features,
                (train, test),
                outputs,
                (signals, noise),
                (added[:, part], added_noise[part]),
            )
    return np.asarray(np.sqrt(square / sum(len(test) for _, test in folds)))


def _squared_errors(
    features: Features,
    fold: tuple[Int, Int],
    outputs: Float,
    given: tuple[Float, Float],
    candidates: tuple[Float, Float],
) -> Float:
    """Return the expected squared error (k,), summed over the test states of a fold."""
    (train, test), (signals, noise), (added, added_noise) = fold, given, candidates
    k, c = added.shape[1], signals.shape[1]
    is_new = (features.linear[:, c] != 0) | features.hessian[:, c].any(axis=1)
    old = replace(features, linear=features.linear[~is_new], hessian=features.hessian[~is_new])
    new = replace(features, linear=features.linear[is_new], hessian=features.hessian[is_new])
    every = np.empty((k, len(signals), c + 1))  # signals by candidate
    every[..., :c], every[..., c] = signals, added.T
    scale = np.concatenate([np.broadcast_to(noise, (k, c)), added_noise[:, None]], axis=1)
    assumed = features.uncertainty(scale)[:, None, None, :]
    base = np.concatenate([signals, np.zeros((len(signals), 1))], axis=1)

    # The given channels, once.
    phi0, slopes0 = old(base), old.slopes(base)
    mean0, mean_out = phi0[train].mean(axis=0), outputs[train].mean(axis=0)
    p0, out = phi0[train] - mean0, outputs[train] - mean_out
    w0 = (slopes0[train] * assumed[0])[..., :c]  # none of them depends on the new channel
    a = regularize(p0.T @ p0 + np.einsum("nfc,ngc->fg", w0, w0))
    beta0 = np.linalg.solve(a, p0.T @ out)

    # The border of each candidate.
    phi1, slopes1 = new(every), new.slopes(every)
    mean1 = phi1[:, train].mean(axis=1)
    p1 = phi1[:, train] - mean1[:, None]
    w1 = slopes1[:, train] * assumed
    b = p0.T @ p1 + np.einsum("nfc,kngc->kfg", w0, w1[..., :c])
    flat = w1.transpose(0, 2, 1, 3).reshape(k, w1.shape[2], -1)
    d = regularize(p1.swapaxes(1, 2) @ p1 + flat @ flat.swapaxes(1, 2))
    ab = np.linalg.solve(np.broadcast_to(a, (k, *a.shape)), b) if len(a) else b
    right = p1.swapaxes(1, 2) @ out - ab.swapaxes(1, 2) @ (p0.T @ out)
    beta1 = np.linalg.solve(d - b.swapaxes(1, 2) @ ab, right)
    beta = np.concatenate([beta0 - ab @ beta1, beta1], axis=1)

    # The residuals of the test states, and the error that noise adds.
    phi = np.concatenate(
        [
            np.broadcast_to(phi0[test] - mean0, (k, len(test), len(mean0))),
            phi1[:, test] - mean1[:, None],
        ],
        axis=2,
    )
    residual = phi @ beta - (outputs[test] - mean_out)
    slopes = np.concatenate(
        [np.broadcast_to(slopes0[test], (k, len(test), *slopes0.shape[1:])), slopes1[:, test]],
        axis=2,
    )
    by_signal = slopes.transpose(0, 1, 3, 2) @ beta[:, None]  # (k, t, c + 1, o)
    noisy = np.einsum("kc,ktco,ktco->k", scale**2, by_signal, by_signal)
    return np.asarray((residual**2).sum(axis=(1, 2)) + noisy)
