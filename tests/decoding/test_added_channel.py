"""Test the errors with one more channel against complete fits."""

import numpy as np
import pytest

from defsense_fab.decoding.added_channel import unseen_errors
from defsense_fab.decoding.decoders import fit_decoder


def expected_error(kind, folds, outputs, signals, noise):
    """Return the expected error on unseen states by complete fits."""
    square = 0.0
    for train, test in folds:
        decoder = fit_decoder(kind, signals[train], outputs[train], noise)
        square += ((decoder(signals[test]) - outputs[test]) ** 2).sum()
        square += decoder.noise_variance(signals[test], noise).sum()
    return np.sqrt(square / sum(len(test) for _, test in folds))


@pytest.mark.parametrize("kind", ["affine", "quadratic"])
@pytest.mark.parametrize("there", [0, 1, 3])
def test_error_equals_that_of_a_fit_with_the_channel(kind, there):
    rng = np.random.default_rng(3)
    cause = rng.normal(size=(20, 4))
    signals = 0.1 * np.tanh(cause @ rng.normal(size=(4, there)))
    added = 0.1 * np.tanh(cause @ rng.normal(size=(4, 7)))
    added[:, 0] = 0.0  # has no information
    if there:
        added[:, 1] = signals[:, 0]  # has no new information
    outputs = np.concatenate([cause, cause[:, :2] ** 2], axis=1)
    noise, added_noise = rng.uniform(1e-3, 4e-3, there), rng.uniform(1e-3, 4e-3, 7)
    everything = np.arange(20)
    tests = (np.arange(3, 7), np.array([9, 15, 19]))
    folds = [(np.setdiff1d(everything, test), test) for test in tests]
    errors = unseen_errors(kind, folds, outputs, signals, noise, added, added_noise)
    for k, error in enumerate(errors):
        whole = np.concatenate([signals, added[:, [k]]], axis=1)
        all_noise = np.append(noise, added_noise[k])
        expected = expected_error(kind, folds, outputs, whole, all_noise)
        assert error == pytest.approx(expected, rel=1e-7)
    assert np.ptp(errors) > 0.01
