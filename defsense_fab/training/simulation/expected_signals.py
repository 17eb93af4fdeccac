"""What the simulation lets expect of the signals where the markers are: for noticing channels that
are exchanged or changed, before anything is trained on them."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...decoding.input_features import InputFeatures, all_products
from ..data.dataset import Recording
from ..ridge.weighted_ridge import Whitened, solve, sums
from .prior import Prior

_MOVEMENTS = 4  # main ones of the states
_RIDGE = 1e-3  # of a movement's own square, where few markers are seen
_NOISE = 0.05  # of the movements, in their spread over the states


def expected_signals(prior: Prior, r: Recording, rest_points: Float) -> Float:
    """(R - R0)/R0 (t, c) at the pictures of a recording, whose markers are at rest at (m, 3) mm;
    NaN where fewer than half of the markers are seen. Raises TrainingError where none moves."""
    s, m = prior.displacements.shape[:2]
    flat = prior.displacements.reshape(s, -1)
    _, size, across = np.linalg.svd(flat, full_matrices=False)
    k = min(_MOVEMENTS, int((size > 1e-6 * size[0]).sum()))
    if k == 0:
        raise TrainingError(
            "no marker moves in any of the simulated states; put markers where the poses move the"
            " device",
            code="markers-do-not-move",
        )
    V = across[:k]
    states = flat @ V.T
    spread = np.maximum(states.std(0), 1e-9)
    features = InputFeatures(k, all_products(k), np.zeros((0, k)), np.ones(k))

    def made_of(movements: Float) -> Float:
        return features(movements / spread)

    phi = made_of(states)
    whitened = Whitened.of(phi, features.slopes(states / spread), features.roughness())
    told = sums(whitened(phi), prior.signals[:, :, None], np.ones_like(prior.signals),
                np.zeros(s, np.int64))  # fmt: skip
    beta, constant = solve(told.without(), np.array([_NOISE]))

    moved = (r.points - rest_points).reshape(len(r.time), -1)
    known = np.isfinite(moved)
    normal = np.einsum("ka,ta,la->tkl", V, known.astype(float), V) + _RIDGE * np.eye(k)
    seen = np.where(known, moved, 0.0) @ V.T
    movements = np.linalg.solve(normal, seen[:, :, None])[:, :, 0]
    out = whitened(made_of(movements)) @ beta[0] + constant[0]
    out[known.sum(axis=1) < 1.5 * m] = np.nan
    return np.asarray(out)
