"""Test every decoder by name: noise, accuracy, and cross-validation in contiguous folds."""

import numpy as np
import pytest
from sklearn.kernel_ridge import KernelRidge
from sklearn.model_selection import GridSearchCV

from defsense_fab.core.device.device import DECODERS
from defsense_fab.decoding.decoders import contiguous_folds, fit_decoder
from defsense_fab.decoding.elimination import expected_square
from defsense_fab.decoding.ridge import fit_ridge, quadratic_features


def curved(count, rng, channels=2):
    """Return random signals, and outputs that are smooth but not affine in them."""
    s = 0.05 * rng.uniform(-1, 1, (count, channels))
    x, y = 20 * s[:, 0], 20 * s[:, 1]
    return s, np.stack([3 * x + x * y, np.sin(2 * x) - y, y**2], axis=1)


@pytest.mark.parametrize("kind", DECODERS)
def test_noise_variance_equals_that_of_sampled_noise(kind):
    rng = np.random.default_rng(0)
    signals, outputs = curved(60, rng)
    decoder = fit_decoder(kind, signals, outputs, 5e-4)
    some = signals[:5]
    noisy = some + rng.normal(0, 5e-4, (4000, 5, 2))
    result = decoder(noisy.reshape(-1, 2)).reshape(4000, 5, 3).var(0)
    assert result == pytest.approx(decoder.noise_variance(some, 5e-4), rel=0.15, abs=1e-7)


def test_flexible_decoders_are_better_on_curved_maps():
    rng = np.random.default_rng(1)
    signals, outputs = curved(80, rng)
    unseen, truth = curved(200, rng)
    error = {}
    for kind in DECODERS:
        decoder = fit_decoder(kind, signals, outputs, 1e-4)
        error[kind] = np.sqrt(((decoder(unseen) - truth) ** 2).sum(1).mean())
    assert error["affine"] > 2 * error["quadratic"] > 2 * 2 * error["kernel"]


@pytest.mark.parametrize("seed", range(3))
def test_width_and_weight_equal_those_of_scikit_learn(seed):
    """Its search uses the decoder's training samples and contiguous folds."""
    rng = np.random.default_rng(seed)
    signals, outputs = curved(21, rng, channels=2)
    noise = np.array([0.002, 0.005])
    decoder = fit_decoder("kernel", signals, outputs, noise)
    folds = [
        (np.setdiff1d(np.arange(105), test), test)
        for test in (np.arange(105).reshape(21, 5)[k].ravel() for _, k in contiguous_folds(21))
    ]
    search = GridSearchCV(
        KernelRidge(kernel="rbf"),
        {"gamma": np.logspace(-2, 0.5, 6), "alpha": np.logspace(-6, 1, 8)},
        scoring="neg_mean_squared_error",
        cv=folds,
    ).fit(decoder.trained / decoder.scale, np.repeat(outputs, 5, axis=0) - outputs.mean(0))
    result = {"gamma": decoder.gamma, "alpha": decoder.alpha}
    assert search.best_params_ == pytest.approx(result)
    spread = decoder.trained.reshape(21, 5, 2).std(1)
    assert spread == pytest.approx(np.broadcast_to(noise * np.sqrt(4 / 5), (21, 2)))


def test_kernel_decoder_equals_scikit_learn():
    rng = np.random.default_rng(2)
    signals, outputs = curved(40, rng)
    decoder = fit_decoder("kernel", signals, outputs, 0.0)
    peer = KernelRidge(kernel="rbf", gamma=decoder.gamma, alpha=decoder.alpha)
    peer.fit(decoder.trained / decoder.scale, np.repeat(outputs, 5, axis=0) - outputs.mean(0))
    other_signals, _ = curved(30, rng)
    expected = peer.predict(other_signals / decoder.scale) + outputs.mean(0)
    assert decoder(other_signals) == pytest.approx(expected, abs=1e-9)
    refitted = fit_decoder("kernel", signals, outputs, 0.0, decoder)
    assert refitted(other_signals) == pytest.approx(decoder(other_signals), abs=1e-9)


def test_folds_are_runs_of_neighbors():
    folds = contiguous_folds(13)
    assert len(folds) == 5
    assert np.concatenate([test for _, test in folds]).tolist() == list(range(13))
    for train, test in folds:
        assert (np.diff(test) == 1).all()
        assert set(train) | set(test) == set(range(13))
        assert not set(train) & set(test)


@pytest.mark.parametrize(("channels", "states"), [(3, 3), (4, 3), (3, 2), (6, 5), (3, 8)])
def test_expected_error_where_features_outnumber_states(channels, states):
    """It is between zero and the outputs' own size, and equals that of the fitted decoder."""
    rng = np.random.default_rng(0)
    features = quadratic_features(channels)
    for _ in range(50):
        signals = np.concatenate(
            [np.zeros((1, channels)), 0.05 * rng.normal(size=(states - 1, channels))]
        )
        signals[:, -1] = signals[:, 0]  # two cords have the same signal
        outputs = rng.normal(size=(states, 4))
        outputs -= outputs.mean(0)
        result = float(expected_square(features, signals, outputs, 0.002))
        decoder = fit_ridge(features, signals, outputs, 0.002)
        expected = ((decoder(signals) - outputs) ** 2).sum()
        expected += decoder.noise_variance(signals, 0.002).sum()
        assert 0 <= result <= (outputs**2).sum() * (1 + 1e-12)
        assert result == pytest.approx(expected, rel=1e-2, abs=1e-6)


def test_every_decoder_fits_a_single_state():
    for kind in DECODERS:
        decoder = fit_decoder(kind, np.array([[0.01, 0.0]]), np.array([[1.0, 2.0]]), 0.002)
        assert decoder(np.array([[0.01, 0.0]])) == pytest.approx(np.array([[1.0, 2.0]]))
