"""Ridge regression with one more channel, for thousands of channels that might be it.

Features of the channels that there are do not change: their part of the normal matrix is solved
once. What the new channel brings (one feature, or with squares and products c + 2 of them) borders
it, and block elimination leaves a small system for each candidate. The fits are those of
`ridge.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.arrays import Float, Int
from .ridge import KINDS, Features, regular

_CHUNK = 1000  # candidates at once


def unseen_errors(
    kind: str,
    folds: Sequence[tuple[Int, Int]],
    outputs: Float,
    signals: Float,
    noise: Float,
    added: Float,
    added_noise: Float,
) -> Float:
    """Expected RMSE (k,) of ridge decoders of a `kind` on what they were not trained on, for the
    signals (n, c) with noise (c,) and each of the `added` (n, k) with noise (k,) in turn.

    `folds` are states to train on and to test on; `outputs` (n, o) are scaled so that a row's
    squared norm is what is to be averaged (`reduce_outputs`); c may be 0.
    """
    features = KINDS[kind](signals.shape[1] + 1)
    square = np.zeros(added.shape[1])
    for first in range(0, len(square), _CHUNK):
        part = slice(first, first + _CHUNK)
        for seen, test in folds:
            square[part] += _square(
                features, seen, test, outputs, signals, noise, added[:, part], added_noise[part]
            )
    return np.asarray(np.sqrt(square / sum(len(test) for _, test in folds)))


def _square(
    features: Features, seen: Int, test: Int, outputs: Float, signals: Float, noise: Float,
    added: Float, added_noise: Float,
) -> Float:  # fmt: skip
    """Expected squared error (k,), summed over the states `test`."""
    k, c = added.shape[1], signals.shape[1]
    of_new = (features.linear[:, c] != 0) | features.second[:, c].any(axis=1)
    old = replace(features, linear=features.linear[~of_new], second=features.second[~of_new])
    new = replace(features, linear=features.linear[of_new], second=features.second[of_new])
    every = np.empty((k, len(signals), c + 1))  # signals by candidate
    every[..., :c], every[..., c] = signals, added.T
    scale = np.concatenate([np.broadcast_to(noise, (k, c)), added_noise[:, None]], axis=1)
    counted = features.uncertainty(scale)[:, None, None, :]
    base = np.concatenate([signals, np.zeros((len(signals), 1))], axis=1)

    # The channels that there are, once.
    phi0, slopes0 = old(base), old.slopes(base)
    mean0, mean_out = phi0[seen].mean(axis=0), outputs[seen].mean(axis=0)
    p0, out = phi0[seen] - mean0, outputs[seen] - mean_out
    w0 = (slopes0[seen] * counted[0])[..., :c]  # nothing of them hangs on the new channel
    a = regular(p0.T @ p0 + np.einsum("nfc,ngc->fg", w0, w0))
    beta0 = np.linalg.solve(a, p0.T @ out)

    # The border that each candidate brings.
    phi1, slopes1 = new(every), new.slopes(every)
    mean1 = phi1[:, seen].mean(axis=1)
    p1 = phi1[:, seen] - mean1[:, None]
    w1 = slopes1[:, seen] * counted
    b = p0.T @ p1 + np.einsum("nfc,kngc->kfg", w0, w1[..., :c])
    flat = w1.transpose(0, 2, 1, 3).reshape(k, w1.shape[2], -1)
    d = regular(p1.swapaxes(1, 2) @ p1 + flat @ flat.swapaxes(1, 2))
    ab = np.linalg.solve(np.broadcast_to(a, (k, *a.shape)), b) if len(a) else b
    told = p1.swapaxes(1, 2) @ out - ab.swapaxes(1, 2) @ (p0.T @ out)
    beta1 = np.linalg.solve(d - b.swapaxes(1, 2) @ ab, told)
    beta = np.concatenate([beta0 - ab @ beta1, beta1], axis=1)

    # What is left on the states to test, and what noise adds.
    phi = np.concatenate(
        [
            np.broadcast_to(phi0[test] - mean0, (k, len(test), len(mean0))),
            phi1[:, test] - mean1[:, None],
        ],
        axis=2,
    )
    left = phi @ beta - (outputs[test] - mean_out)
    slopes = np.concatenate(
        [np.broadcast_to(slopes0[test], (k, len(test), *slopes0.shape[1:])), slopes1[:, test]],
        axis=2,
    )
    moved = slopes.transpose(0, 1, 3, 2) @ beta[:, None]  # (k, t, c + 1, o)
    noisy = np.einsum("kc,ktco,ktco->k", scale**2, moved, moved)
    return np.asarray((left**2).sum(axis=(1, 2)) + noisy)
