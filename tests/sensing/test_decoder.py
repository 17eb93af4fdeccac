"""The decoder against scikit-learn, its noise model against sampling, and the floor."""

import numpy as np
import pytest
from sklearn.linear_model import Ridge

from defsense_fab.sensing.decoder import fit_affine, floor, measure, ridge_weight


@pytest.fixture
def data():
    rng = np.random.default_rng(0)
    S = rng.normal(size=(30, 3))
    return S, S @ rng.normal(size=(3, 12)) + 0.1 * rng.normal(size=(30, 12)) + 4


def test_same_as_sklearn(data):
    S, O = data  # noqa: E741
    ours, theirs = fit_affine(S, O, 0.3), Ridge(alpha=0.3).fit(S, O)
    assert ours.weights == pytest.approx(theirs.coef_.T, abs=1e-12)
    assert ours.constant == pytest.approx(theirs.intercept_, abs=1e-12)


def test_expected_error_under_noise_matches_sampling(data):
    S, O = data  # noqa: E741
    sigma = 0.1
    decoder = fit_affine(S, O, ridge_weight(len(S), sigma))
    rng = np.random.default_rng(1)
    sampled = np.mean(
        [((decoder(S + rng.normal(0, sigma, S.shape)) - O) ** 2).sum() for _ in range(2000)]
    )
    expected = ((decoder(S) - O) ** 2).sum() + len(S) * sigma**2 * (decoder.weights**2).sum()
    assert sampled == pytest.approx(expected, rel=0.02)


def test_floor_is_reached_by_the_leading_directions_and_by_nothing_better(data):
    _, O = data  # noqa: E741
    low = floor(O, 3)
    u = np.linalg.svd(O - O.mean(0))[0][:, :3]
    best = fit_affine(u, O, 0.0)(u) - O
    assert np.sqrt((best**2).sum() / len(O)) == pytest.approx(low, rel=1e-9)
    rng = np.random.default_rng(2)
    for _ in range(20):
        S = rng.normal(size=(30, 3))
        error = fit_affine(S, O, 0.0)(S) - O
        assert np.sqrt((error**2).sum() / len(O)) >= low


def test_measures_by_hand():
    truth = np.zeros((2, 2, 3))
    guess = truth.copy()
    guess[1, 0] = [3, 4, 0]
    m = measure(guess, truth, np.array([0.5, 0.5]))
    assert m.peak == 5
    assert m.average_peak == 2.5
    assert m.rmse == pytest.approx(np.sqrt(25 / 4))
    assert m.per_state == pytest.approx([0, np.sqrt(12.5)])
