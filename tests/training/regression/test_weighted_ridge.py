"""Ridge over folds against scikit-learn, and folds that are shuffled."""

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
    """Whitened features of an affine map, and how they were whitened."""
    c = inputs.shape[1]
    features = InputFeatures(c, no_products(), np.zeros((0, c)), np.ones(c))
    whitened = Whitening.of(features(inputs), features.slopes(inputs), features.roughness())
    return whitened(features(inputs)), whitened


@pytest.fixture
def data() -> tuple[Float, Float, Float]:
    rng = np.random.default_rng(3)
    x = rng.normal(size=(400, 4)) * [0.01, 0.05, 0.1, 0.2] + 0.3
    o = np.tensordot(x, 10 * rng.normal(size=(4, 5, 3)), 1) + rng.normal(size=(400, 5, 3))
    return x, o, rng.uniform(0.2, 2.0, (400, 5)) * (rng.random((400, 5)) > 0.2)


def test_an_affine_map_is_that_of_a_library_s_ridge_for_every_marker(
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


def test_what_is_not_known_does_not_count(data: tuple[Float, Float, Float]) -> None:
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


def test_errors_on_folds_are_those_of_decoders_fitted_without_them(
    data: tuple[Float, Float, Float],
) -> None:
    x, o, w = data
    phi, whitened = affine(x)
    fold = assign_folds(400, 5)
    found = accumulate_sums(phi, o, w, fold)
    path = cross_validate(found, noises=np.array([0.02, 0.2]))
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
    found = accumulate_sums(phi, o, w, np.zeros(400, int))
    rng = np.random.default_rng(0)
    B, b = rng.normal(size=(2, 4, 15)), rng.normal(size=(2, 15))
    off = (np.einsum("tf,sfo->sto", phi, B) + b[:, None] - o.reshape(400, 15)) ** 2
    expected = (off * np.repeat(w, 3, axis=1)).sum(1)
    np.testing.assert_allclose(sum_squared_errors(found.only(0), B, b), expected, rtol=1e-10)


def test_shuffled_folds_choose_a_far_smaller_lambda_and_lie() -> None:
    """Signals drift and markers creep, neither with the other: pictures beside each other let a map
    explain the creep by the drift, and only folds of neighbours show that it explains nothing."""
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
    told, tested, noise = [], [], []
    for fold in (assign_folds(n), rng.permutation(assign_folds(n))):
        found = accumulate_sums(phi, o[:n], np.ones((n, m)), fold)
        path = cross_validate(found)
        beta, constant = solve_ridge(found.without(), np.array([path.noise]))
        off = (after @ beta[0] + constant[0]).reshape(-1, m, 3) - o[n:]
        noise.append(path.noise)
        told.append(path.rmse)
        tested.append(np.sqrt((off**2).sum(2).mean()))
    assert noise[1] < noise[0] / 100
    assert told[0] > 0.7 * tested[0]
    assert told[1] < 0.01 * tested[1]
    assert tested[0] < 0.7 * tested[1]
