"""Weighted ridge regression compared with scikit-learn, and shuffled folds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from sklearn.linear_model import Ridge

from defsense_fab.core.arrays import Float
from defsense_fab.decoding.input_decoder import InputFeatures, no_products
from defsense_fab.training.regression.frames import assign_folds
from defsense_fab.training.regression.weighted_ridge import (
    Whitening,
    accumulate_sums,
    cross_validate,
    solve_ridge,
    sum_squared_errors,
)

from ..conftest import walk


def affine(inputs: Float) -> tuple[Float, Whitening]:
    """Return whitened features of an affine map, and the transform."""
    c = inputs.shape[1]
    features = InputFeatures(c, no_products(), np.zeros((0, c)), np.ones(c))
    whitened, x = Whitening.fit(features, inputs)
    return x, whitened


@pytest.fixture
def data() -> tuple[Float, Float, Float]:
    rng = np.random.default_rng(3)
    x = rng.normal(size=(400, 4)) * [0.01, 0.05, 0.1, 0.2] + 0.3
    o = np.tensordot(x, 10 * rng.normal(size=(4, 5, 3)), 1) + rng.normal(size=(400, 5, 3))
    return x, o, rng.uniform(0.2, 2.0, (400, 5)) * (rng.random((400, 5)) > 0.2)


def test_an_affine_map_agrees_with_scikit_learn_for_every_marker(
    data: tuple[Float, Float, Float],
) -> None:
    x, o, w = data
    phi, whitened = affine(x)
    noise = 0.03
    beta, constant = solve_ridge(
        accumulate_sums(phi, o, w, np.zeros(400, int)).without(), np.array([noise])
    )
    B, b = whitened.undo(beta[0], constant[0])
    for m in range(5):
        peer = Ridge(alpha=noise**2 * w[:, m].sum(), solver="cholesky", tol=1e-12)
        peer.fit(x, o[:, m], sample_weight=w[:, m])
        np.testing.assert_allclose(B[:, 3 * m : 3 * m + 3], peer.coef_.T, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(b[3 * m : 3 * m + 3], peer.intercept_, rtol=1e-9, atol=1e-9)


def test_unknown_outputs_do_not_count(data: tuple[Float, Float, Float]) -> None:
    x, o, w = data
    phi, _ = affine(x)
    holes = np.where(w[..., None] > 0, o, np.nan)
    one = np.zeros(400, int)
    for a, b in zip(
        solve_ridge(accumulate_sums(phi, o, w, one).without(), np.array([0.01])),
        solve_ridge(accumulate_sums(phi, holes, w, one).without(), np.array([0.01])),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)


def test_cross_validated_errors_agree_with_scikit_learn(
    data: tuple[Float, Float, Float],
) -> None:
    x, o, w = data
    phi, whitened = affine(x)
    fold = assign_folds(400, 5)
    result = accumulate_sums(phi, o, w, fold)
    path = cross_validate(result, noises=np.array([0.02, 0.2]))
    for k in range(5):
        for s, noise in enumerate(path.noises):
            square = 0.0
            for m in range(5):
                train, test = fold != k, fold == k
                peer = Ridge(alpha=noise**2 * w[train, m].sum(), solver="cholesky", tol=1e-12)
                peer.fit(x[train], o[train, m], sample_weight=w[train, m])
                off = ((peer.predict(x[test]) - o[test, m]) ** 2).sum(1)
                square += (w[test, m] * off).sum()
            assert path.errors[k, s] == pytest.approx(np.sqrt(square / w[fold == k].sum()))
    assert whitened.mean == pytest.approx(x.mean(0))


def test_squared_errors_follow_from_sums(data: tuple[Float, Float, Float]) -> None:
    x, o, w = data
    phi, _ = affine(x)
    result = accumulate_sums(phi, o, w, np.zeros(400, int))
    rng = np.random.default_rng(0)
    B, b = rng.normal(size=(2, 4, 15)), rng.normal(size=(2, 15))
    off = (np.einsum("tf,sfo->sto", phi, B) + b[:, None] - o.reshape(400, 15)) ** 2
    expected = (off * np.repeat(w, 3, axis=1)).sum(1)
    np.testing.assert_allclose(sum_squared_errors(result.only(0), B, b), expected, rtol=1e-10)


def test_shuffled_folds_underestimate_the_error() -> None:
    """Signals drift and markers creep independently.

    With shuffled folds, a map seems to explain the creep by the drift; contiguous folds show that
    it does not.
    """
    rng = np.random.default_rng(0)
    n, c, m = 900, 40, 4
    time = np.arange(n * 10 // 7) / 30
    knots = np.linspace(0, time[-1], 44)
    moves, drift = walk(time, 2, rng), CubicSpline(knots, rng.normal(size=(44, c)))(time)
    x = 0.02 * drift + 2e-6 * rng.normal(size=drift.shape)
    x[:, :2] += 0.3 * moves
    o = 10 * moves @ rng.normal(size=(2, m * 3))
    o = (o + 2 * CubicSpline(knots, rng.normal(size=(44, m * 3)))(time)).reshape(-1, m, 3)
    phi, _ = affine(x[:n])
    after = affine(x[:n])[1](x[n:])
    predicted_rmse, tested, noise = [], [], []
    for fold in (assign_folds(n), rng.permutation(assign_folds(n))):
        result = accumulate_sums(phi, o[:n], np.ones((n, m)), fold)
        path = cross_validate(result)
        beta, constant = solve_ridge(result.without(), np.array([path.noise]))
        off = (after @ beta[0] + constant[0]).reshape(-1, m, 3) - o[n:]
        noise.append(path.noise)
        predicted_rmse.append(path.rmse)
        tested.append(np.sqrt((off**2).sum(2).mean()))
    assert noise[1] < noise[0] / 100
    assert predicted_rmse[0] > 0.7 * tested[0]
    assert predicted_rmse[1] < 0.01 * tested[1]
    assert tested[0] < 0.7 * tested[1]
