"""Features of trained decoders: slopes, noise, roughness."""

from __future__ import annotations

import numpy as np

from defsense_fab.decoding.input_features import InputDecoder, InputFeatures, all_products


def made() -> InputDecoder:
    rng = np.random.default_rng(0)
    features = InputFeatures(5, all_products(3), rng.normal(size=(4, 3)), rng.uniform(0.5, 2, 3))
    weights = rng.normal(size=(features.count, 6))
    return InputDecoder(features, weights, rng.normal(size=6))


def test_slopes_are_those_of_finite_differences() -> None:
    f = made().features
    z = np.random.default_rng(1).normal(size=(7, 5))
    step = 1e-6
    for k in range(5):
        move = step * np.eye(5)[k]
        expected = (f(z + move) - f(z - move)) / (2 * step)
        np.testing.assert_allclose(f.slopes(z)[:, :, k], expected, atol=1e-8)


def test_one_sample_is_decoded_as_many_are() -> None:
    decoder = made()
    z = np.random.default_rng(1).normal(size=(7, 5))
    one = np.array([decoder.one(row) for row in z])
    np.testing.assert_allclose(one, decoder(z), rtol=1e-12, atol=1e-12)


def test_roughness_is_the_norm_of_the_radial_functions() -> None:
    """Of one center it is its weight squared by its width squared; of two that coincide, that of
    their sum."""
    two = InputFeatures(1, np.zeros((0, 2), int), np.zeros((2, 1)), np.array([0.5]))
    w = np.array([0.0, 2.0, -2.0])
    assert w @ two.roughness() @ w == 0
    one = InputFeatures(1, np.zeros((0, 2), int), np.zeros((1, 1)), np.array([0.5]))
    assert np.array([9.0, 3.0]) @ one.roughness() @ [9.0, 3.0] == 36.0
