"""Test interpolation between samples, and memories of signals against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.decoding.signal_history import Past, PastStream, interpolate_at


def test_rounded_times_match_the_samples() -> None:
    time = np.arange(5) / 30
    values = np.array([[1.0], [5.0], [np.nan], [7.0], [2.0]])
    values_at = interpolate_at(np.round(time, 6), time, values)
    np.testing.assert_array_equal(values_at, values)
    between = interpolate_at(np.array([1 / 60, 0.05, -1e-3, 4 / 30 + 1e-3]), time, values)
    np.testing.assert_allclose(between[:, 0], [3.0, np.nan, np.nan, np.nan])


def test_values_in_long_gaps_are_nan() -> None:
    values_at = interpolate_at(np.array([0.5, 0.02]), np.array([0.0, 0.04, 1.0]), np.ones((3, 1)))
    np.testing.assert_array_equal(values_at[:, 0], [np.nan, 1.0])


def test_step_decays_with_the_time_constant() -> None:
    time = np.concatenate([[0.0, 1.0], 1.001 + np.arange(0, 5, 0.01)])
    step = np.where(time > 1.0005, 0.1, 0.0)[:, None]
    z = Past(moved=(2.0,))(time, step)
    expected = 0.1 * np.exp(-(time - 1.001) / 2.0)
    np.testing.assert_allclose(z[2:, 1], expected[2:], rtol=1e-3)


def test_slope_lags_by_the_slope_times_the_time_constant() -> None:
    time = np.linspace(0, 30, 200)
    z = Past(moved=(1.5,))(time, 0.02 * time[:, None])
    assert z[-1, 1] == pytest.approx(0.03, rel=1e-6)


def test_sampling_rate_does_not_matter() -> None:
    coarse = np.arange(0, 10, 0.1)
    fine = np.arange(0, 9.9 + 1e-9, 0.01)
    signal = np.random.default_rng(0).normal(size=(len(coarse), 2)).cumsum(0)
    between = np.stack([np.interp(fine, coarse, s) for s in signal.T], axis=1)
    past = Past(moved=(0.4, 3.0))
    np.testing.assert_allclose(past(coarse, signal), past(fine, between)[::10], atol=1e-9)


def test_work_increases_with_the_distance_in_either_direction() -> None:
    time = np.arange(0, 20, 1 / 60)
    up = np.clip(time - 5, 0, 1)[:, None]
    q = Past(worked=(1000.0,))(time, np.concatenate([up, -up], axis=1))[:, 2:]
    np.testing.assert_allclose(q[:, 0], q[:, 1])
    assert q[-1, 0] == pytest.approx(1.0, rel=0.02)


def test_stream_equals_the_whole_recording() -> None:
    rng = np.random.default_rng(1)
    time = np.sort(rng.uniform(0, 20, 300))
    signals = rng.normal(size=(300, 3)).cumsum(0) * 0.01
    signals[100:110, 1] = np.nan
    past = Past((0.3, 8.0), (2.0,))
    stream = PastStream(past, 3)
    one = np.array([stream(t, s) for t, s in zip(time, signals, strict=True)])
    np.testing.assert_array_equal(one, past(time, signals))
    assert np.isnan(one[100:110, 1]).all()
    assert np.isfinite(one[110:]).all()


def test_inputs_without_memories_are_the_signals() -> None:
    signals = np.random.default_rng(0).normal(size=(5, 2))
    np.testing.assert_array_equal(Past()(np.arange(5.0), signals), signals)


def test_memories_start_at_the_first_valid_sample() -> None:
    time = np.arange(200) / 60
    signals = 0.1 * np.sin(time)[:, None]
    late = signals.copy()
    late[:5] = np.nan
    z = Past((0.5,), (2.0,))(time, late)
    assert np.isfinite(z[5:]).all()
    assert np.isnan(z[:5]).all()
    np.testing.assert_allclose(z[5:], Past((0.5,), (2.0,))(time[5:], signals[5:]))


def test_nan_samples_equal_missing_samples() -> None:
    time = np.arange(600) / 60
    signals = 0.01 * time[:, None]
    gone = signals.copy()
    gone[100:400] = np.nan
    past = Past((1.0,), (2.0,))
    valid = np.r_[:100, 400:600]
    np.testing.assert_allclose(past(time, gone)[valid], past(time[valid], signals[valid]))


def test_rescaled_stream_continues_as_if_scaled_from_the_start() -> None:
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.005, 0.03, 600))
    signals = 0.1 * np.sin(np.outer(time, [1.0, 1.7]))
    scale, shift = np.array([0.97, 1.02]), np.array([-0.03, 0.02])
    past = Past((0.5, 5.0, 50.0))
    whole = past(time, signals * scale + shift)
    stream = PastStream(past, 2)
    for k in range(300):
        stream(time[k], signals[k])
    stream.rescale(scale, shift)
    for k in range(300, 600):
        assert stream(time[k], signals[k] * scale + shift) == pytest.approx(whole[k], abs=1e-12)
