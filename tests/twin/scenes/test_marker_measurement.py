"""Simulated measurements of markers: noise, gaps and outliers."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.twin.scenes.assumptions import disable_traits
from defsense_fab.twin.scenes.marker_measurement import MarkerTraits, measure_markers

TIME = np.arange(0, 200, 1 / 30)
POINTS = np.broadcast_to(np.arange(24.0).reshape(8, 3), (len(TIME), 8, 3))


def measure(traits, seed=0):
    return measure_markers(TIME, POINTS, 2, traits, np.random.default_rng(seed))


def test_noise_has_the_reported_standard_deviation():
    positions, sigma = measure(MarkerTraits())
    is_visible = np.isfinite(positions[..., 0])
    assert np.array_equal(is_visible, np.isfinite(sigma[..., 0]))
    assert (positions - POINTS)[is_visible].std(axis=0) == pytest.approx(
        [0.08, 0.08, 0.2], rel=0.02
    )
    assert sigma[is_visible] == pytest.approx(
        np.broadcast_to([0.08, 0.08, 0.2], (is_visible.sum(), 3))
    )


def test_gaps_have_the_specified_share_and_length():
    hidden = np.isnan(measure(MarkerTraits())[0][..., 0])
    assert hidden.mean() == pytest.approx(0.05, abs=0.015)
    starts = (np.diff(hidden.astype(int), axis=0) == 1).sum()
    assert hidden.sum() / starts / 30 == pytest.approx(0.7, rel=0.25)


def test_disabled_traits_have_no_effect_and_leave_others_unchanged():
    exact, sigma = measure(disable_traits(MarkerTraits(), {"marker-noise", "gaps"}))
    assert exact == pytest.approx(POINTS, abs=0)
    assert (sigma > 0).all()
    noisy = measure(disable_traits(MarkerTraits(), {"gaps"}))[0]
    with_gaps = measure(MarkerTraits())[0]
    is_visible = np.isfinite(with_gaps)
    assert np.array_equal(noisy[is_visible], with_gaps[is_visible])


def test_outliers_are_not_reported():
    positions, sigma = measure(replace(MarkerTraits(), wrong=0.03, hidden=0.0))
    is_outlier = np.abs(positions - POINTS).max(axis=2) > 1.2
    assert is_outlier.mean() == pytest.approx(0.03, abs=0.006)
    assert sigma.max() == pytest.approx(0.2)
