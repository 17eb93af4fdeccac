"""What a decoder says of one shape at different times, against noise that is known."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.training.evaluation.predicted_error import PredictedError, Promise
from defsense_fab.training.fitting.repeatability import repeatability
from defsense_fab.training.ridge.frames import Frames


def said(frames, noise=0.0, drift=0.0, seed=1):
    """Displacements (t, m, 3) that are true but for noise along one direction, which all markers
    share, and a drift of so many mm over the whole time."""
    rng = np.random.default_rng(seed)
    true = frames.points - frames.dataset.rest_points
    common = noise * rng.normal(size=len(frames)) + drift * frames.time / np.ptp(frames.time)
    spread = true.std(axis=0)
    way = spread / np.sqrt((spread**2).sum() / spread.shape[0])
    return true + common[:, None, None] * way


@pytest.fixture(scope="module")
def frames(recorded):
    return Frames.all_of(recorded(240, sigma=0.5))


def test_noise_that_shows_share_is_found_as_it_is(frames):
    found = repeatability(frames, said(frames, noise=0.6))
    assert found is not None
    assert np.sqrt(found.at_once + found.drift) == pytest.approx(0.6, rel=0.15)
    assert found.drift < 0.1 * found.at_once
    assert 0.02 < found.share <= 1
    assert np.sqrt(found.cameras) == pytest.approx(0.5 * np.sqrt(3), rel=0.01)


def test_what_is_true_repeats(frames):
    found = repeatability(frames, said(frames))
    assert np.sqrt(found.at_once + found.drift) < 0.1


def test_drift_is_told_from_noise_by_how_far_shows_are_apart(frames):
    found = repeatability(frames, said(frames, noise=0.3, drift=3.0))
    assert np.sqrt(found.drift) > 0.4


def test_clocks_cost_their_error_times_the_speed(frames, recorded):
    dataset = recorded(240, sigma=0.5)
    late = tuple(replace(r, sync_error=0.01) for r in dataset.recordings)
    slow = repeatability(Frames.all_of(replace(dataset, recordings=late)), said(frames))
    later = tuple(replace(r, sync_error=0.02) for r in dataset.recordings)
    fast = repeatability(Frames.all_of(replace(dataset, recordings=later)), said(frames))
    assert slow.clocks > 0
    assert fast.clocks == pytest.approx(4 * slow.clocks)


def test_too_few_shapes_that_come_back_tell_nothing(recorded):
    few = Frames.all_of(recorded(5))
    assert repeatability(few, said(few)) is None


def test_shares_add_up_to_what_is_predicted():
    promise = Promise(0.5, 0.2, 0.4, 0.7)
    shares = {"the design": 0.25, "repeatability": 0.1, "drift": 0.01}
    told = PredictedError(promise, shares, 0.6, 0.9)
    assert told.predicted == pytest.approx(0.6)
    assert told.ratio == pytest.approx(1.0)
    assert told.promised_ratio == pytest.approx(0.5 / 0.6)
    assert np.isnan(PredictedError(None, shares, 0.0, 0.9).ratio)
