"""Test ridge decoders against scikit-learn, their noise against sampling, and error measures."""

import numpy as np
import pytest
from sklearn.linear_model import Ridge
from sklearn.preprocessing import PolynomialFeatures

from defsense_fab.core.device.device import DECODERS
from defsense_fab.decoding.elimination import expected_square
from defsense_fab.decoding.expected_errors import affine_error_floor, measure_errors
from defsense_fab.decoding.ridge import FEATURES, affine_features, fit_ridge, quadratic_features


@pytest.fixture
def data():
    rng = np.random.default_rng(0)
    S = rng.normal(size=(30, 3))
    return S, S @ rng.normal(size=(3, 12)) + 0.1 * rng.normal(size=(30, 12)) + 4


@pytest.fixture(params=FEATURES.values(), ids=FEATURES.keys())
def features(request):
    return request.param(3)


def test_every_decoder_of_a_device_has_features():
    assert set(FEATURES) == set(DECODERS)


def test_weights_equal_scikit_learn(data):
    S, O = data  # noqa: E741
    sigma = np.sqrt(0.3 / len(S))
    ours, theirs = fit_ridge(affine_features(3), S, O, sigma), Ridge(alpha=0.3).fit(S, O)
    assert ours.weights == pytest.approx(theirs.coef_.T, abs=1e-12)
    assert ours.constant == pytest.approx(theirs.intercept_, abs=1e-12)


def test_quadratic_features_equal_scikit_learn(data):
    S, _ = data
    ours, theirs = (
        quadratic_features(3)(S),
        PolynomialFeatures(2, include_bias=False).fit_transform(S),
    )
    assert np.sort(ours, axis=1) == pytest.approx(np.sort(theirs, axis=1))


def test_slopes_equal_finite_differences(features, data):
    S, h = data[0], 1e-6
    slopes = features.slopes(S)
    for c in range(3):
        e = h * np.eye(3)[c]
        assert slopes[..., c] == pytest.approx((features(S + e) - features(S - e)) / (2 * h))


def test_expected_error_under_noise_matches_sampling(features, data):
    S, O = data  # noqa: E741
    sigma = 0.05
    decoder = fit_ridge(features, S, O, sigma)
    rng = np.random.default_rng(1)
    sampled = np.mean(
        [((decoder(S + rng.normal(0, sigma, S.shape)) - O) ** 2).sum() for _ in range(2000)]
    )
    expected = ((decoder(S) - O) ** 2).sum() + decoder.noise_variance(S, sigma).sum()
    assert sampled == pytest.approx(expected, rel=0.02)
    centered = O - O.mean(0)
    many = expected_square(features, np.stack([S, 2 * S, S]), centered, sigma)
    assert many[[0, 2]] == pytest.approx(expected)
    assert many[1] < expected


def test_no_other_map_has_a_lower_expected_error(features, data):
    S, O = data  # noqa: E741
    best = fit_ridge(features, S, O, 0.1)
    rng = np.random.default_rng(3)

    def error(decoder):
        return ((decoder(S) - O) ** 2).sum() + decoder.noise_variance(S, 0.1).sum()

    for _ in range(20):
        step = 1e-3 * rng.normal(size=best.weights.shape)
        other = type(best)(features, best.weights + step, best.constant)
        assert error(other) > error(best)


def test_error_floor_is_reached_by_the_leading_directions_only(data):
    _, O = data  # noqa: E741
    low = affine_error_floor(O, 3)
    u = np.linalg.svd(O - O.mean(0))[0][:, :3]
    best = fit_ridge(affine_features(3), u, O, 0.0)(u) - O
    assert np.sqrt((best**2).sum() / len(O)) == pytest.approx(low, rel=1e-9)
    rng = np.random.default_rng(2)
    for _ in range(20):
        S = rng.normal(size=(30, 3))
        error = fit_ridge(affine_features(3), S, O, 0.0)(S) - O
        assert np.sqrt((error**2).sum() / len(O)) >= low


def test_error_measures_of_a_small_case():
    truth = np.zeros((2, 2, 3))
    guess = truth.copy()
    guess[1, 0] = [3, 4, 0]
    m = measure_errors(guess, truth, np.array([0.5, 0.5]))
    assert m.peak == 5
    assert m.average_peak == 2.5
    assert m.rmse == pytest.approx(np.sqrt(25 / 4))
    assert m.per_state == pytest.approx([0, np.sqrt(12.5)])
