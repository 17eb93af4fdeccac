"""Test decoders of trained models: features, single samples, and the shared memory."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.decoding.input_decoder import (
    InputDecoder,
    InputFeatures,
    SharedMemory,
    all_products,
)
from defsense_fab.decoding.signal_history import Past
from defsense_fab.training.regression.simulated_decoder import fit_memory


def static_decoder(channels: int = 2) -> InputDecoder:
    rng = np.random.default_rng(0)
    features = InputFeatures(
        channels, all_products(channels), np.zeros((0, channels)), np.ones(channels)
    )
    return InputDecoder(features, 100 * rng.normal(size=(features.count, 6)), np.zeros(6))


def shared_memory() -> SharedMemory:
    return SharedMemory(
        np.array([1.1, 0.9]), np.array([0.01, -0.02]), np.array([-0.2, 0.1]), np.array([-0.05]),
        static_decoder(),
    )  # fmt: skip


def test_ideal_signals_have_no_memory_offset_and_gain() -> None:
    s, h1, h2, q = np.random.default_rng(1).normal(size=(4, 5, 2))
    result = shared_memory().ideal_signals(np.concatenate([s, h1, h2, q], axis=1))
    expected = (s - 0.2 * h1 + 0.1 * h2 - 0.05 * q - [0.01, -0.02]) / [1.1, 0.9]
    np.testing.assert_allclose(result, expected)


def test_shared_memory_decodes_one_sample_like_many() -> None:
    z = np.random.default_rng(1).normal(size=(5, 8))
    np.testing.assert_allclose(
        np.array([shared_memory().decode_sample(row) for row in z]), shared_memory()(z), rtol=1e-12
    )


def test_memory_is_fitted_to_sixty_frames() -> None:
    """The resistance rises with any change and heals, which the memory of work compensates."""
    rng = np.random.default_rng(2)
    time = np.arange(0, 120, 1 / 60)
    ideal = 0.1 * np.stack([np.sin(0.9 * time), np.sin(1.3 * time + 1)], axis=1)
    added = np.zeros_like(ideal)
    for k in range(1, len(time)):
        step = np.abs(ideal[k] - ideal[k - 1])
        added[k] = added[k - 1] * np.exp(-1 / 60 / 8.0) + 0.15 * step
    signals = np.array([1.15, 0.9]) * (ideal + added) + 5e-4 * rng.normal(size=ideal.shape)
    past, decoder = Past((2.0,), (8.0,)), static_decoder()
    z = past(time, signals)
    points = decoder(ideal).reshape(-1, 2, 3)
    frames = np.arange(60) * 60
    is_known = np.ones((len(time), 2), bool)
    is_known[frames[::3], 0] = False
    result = fit_memory(decoder, past, z[frames], points[frames], is_known[frames])
    plain = fit_memory(decoder, Past(), signals[frames], points[frames], is_known[frames])
    error = (result(z).reshape(points.shape) - points)[4000:]
    before = (plain(signals).reshape(points.shape) - points)[4000:]
    assert np.sqrt((error**2).mean()) < 0.4 * np.sqrt((before**2).mean())
    np.testing.assert_allclose(result.gain, [1.15, 0.9], rtol=0.1)
    again = fit_memory(decoder, past, z[frames], points[frames], is_known[frames], result)
    np.testing.assert_allclose(again.gain, result.gain, rtol=1e-3)


def make_decoder() -> InputDecoder:
    rng = np.random.default_rng(0)
    features = InputFeatures(5, all_products(3), rng.normal(size=(4, 3)), rng.uniform(0.5, 2, 3))
    weights = rng.normal(size=(features.count, 6))
    return InputDecoder(features, weights, rng.normal(size=6))


def test_penalty_of_polynomials_is_the_variance_by_noise_of_the_inputs() -> None:
    """Compared with the change of the output by small random changes of the inputs."""
    rng = np.random.default_rng(2)
    f = InputFeatures(4, all_products(3), np.zeros((0, 3)), np.ones(3))
    z, w = rng.normal(size=(200, 4)), rng.normal(size=f.count)
    moved = z + 1e-4 * rng.normal(size=(500, *z.shape))
    change = f(moved.reshape(-1, 4)).reshape(500, 200, -1) @ w - f(z) @ w
    assert w @ f.penalty(z) @ w == pytest.approx((change**2).mean() / 1e-8, rel=0.03)


def test_one_sample_is_decoded_like_many() -> None:
    decoder = make_decoder()
    z = np.random.default_rng(1).normal(size=(7, 5))
    one = np.array([decoder.decode_sample(row) for row in z])
    np.testing.assert_allclose(one, decoder(z), rtol=1e-12, atol=1e-12)


def test_penalty_of_radial_functions_is_the_norm_of_their_sum() -> None:
    """For one center it is the squared weight; for two that coincide, that of their sum."""
    z = np.array([[1.0], [3.0]])
    two = InputFeatures(1, np.zeros((0, 2), int), np.zeros((2, 1)), np.array([0.5]))
    w = np.array([0.0, 2.0, -2.0])
    assert w @ two.penalty(z) @ w == pytest.approx(0, abs=1e-8)
    one = InputFeatures(1, np.zeros((0, 2), int), np.zeros((1, 1)), np.array([0.5]))
    assert np.array([2.0, 3.0]) @ one.penalty(z) @ [2.0, 3.0] == pytest.approx(4.0 + 9.0)
