"""What simulated cameras make of markers' places."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.twin.scenes.assumptions import disable_traits
from defsense_fab.twin.scenes.marker_measurement import MarkerTraits, measure_markers

TIME = np.arange(0, 200, 1 / 30)
POINTS = np.broadcast_to(np.arange(24.0).reshape(8, 3), (len(TIME), 8, 3))


def seen(traits, seed=0):
    return measure_markers(TIME, POINTS, 2, traits, np.random.default_rng(seed))


def test_noise_is_as_it_is_stated():
    places, sigma = seen(MarkerTraits())
    known = np.isfinite(places[..., 0])
    assert np.array_equal(known, np.isfinite(sigma[..., 0]))
    assert (places - POINTS)[known].std(axis=0) == pytest.approx([0.08, 0.08, 0.2], rel=0.02)
    assert sigma[known] == pytest.approx(np.broadcast_to([0.08, 0.08, 0.2], (known.sum(), 3)))


def test_gaps_are_blocks_of_the_share():
    hidden = np.isnan(seen(MarkerTraits())[0][..., 0])
    assert hidden.mean() == pytest.approx(0.05, abs=0.015)
    begins = (np.diff(hidden.astype(int), axis=0) == 1).sum()
    assert hidden.sum() / begins / 30 == pytest.approx(0.7, rel=0.25)


def test_what_is_switched_off_is_off():
    exact, sigma = seen(disable_traits(MarkerTraits(), {"marker-noise", "gaps"}))
    assert exact == pytest.approx(POINTS, abs=0)
    assert (sigma > 0).all()
    noisy = seen(disable_traits(MarkerTraits(), {"gaps"}))[0]
    with_gaps = seen(MarkerTraits())[0]
    known = np.isfinite(with_gaps)
    assert np.array_equal(noisy[known], with_gaps[known])  # what one draws leaves the other as is


def test_wrong_places_are_not_stated():
    places, sigma = seen(replace(MarkerTraits(), wrong=0.03, hidden=0.0))
    far = np.abs(places - POINTS).max(axis=2) > 1.2
    assert far.mean() == pytest.approx(0.03, abs=0.006)
    assert sigma.max() == pytest.approx(0.2)
