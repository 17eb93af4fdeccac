"""R0 is measured first, set anew once rubber has set, and follows drift; a pose is no rest."""

import numpy as np
import pytest

from defsense_fab.runtime.frames.rest_tracker import RestTracker, drift_told

SPAN = np.array([0.2, 0.1])
R0 = np.array([1500.0, 400.0])
RATE = 60.0


def feed(tracker, seconds, level, begin, rng=None, noise=1e-3):
    """`level(t)` (2,) of (R - R0)/R0; the last answer and when it ended."""
    rng = rng or np.random.default_rng(0)
    out = None
    for k in range(round(seconds * RATE)):
        t = k / RATE
        ohms = R0 * (1 + np.asarray(level(t)) + noise * SPAN * 10 * rng.normal(size=2) / 10)
        out = tracker(begin + t, ohms)
    return out, begin + seconds


def still(t):
    return 0.0, 0.0


def test_nothing_is_known_while_it_moves_and_rest_is_the_median_of_the_first_stillness():
    tracker = RestTracker(SPAN)
    told, t = feed(tracker, 5, lambda t: SPAN * np.sin(3 * t), 0.0)
    assert told.ohms is None
    told, _ = feed(tracker, 2, still, t)
    assert told.ohms == pytest.approx(R0, rel=1e-3)
    assert told.resting


def test_the_first_rest_after_movement_sets_rest_at_once_and_drift_counts_from_there():
    tracker = RestTracker(SPAN)
    _, t = feed(tracker, 3, still, 0.0)
    told, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), t)
    assert not told.settled
    set_now = 0.12 * SPAN  # what the first cycles leave
    told, t = feed(tracker, 5, lambda t: set_now, t)
    assert told.settled
    assert told.ohms == pytest.approx(R0 * (1 + set_now), rel=2e-3)
    assert np.abs(told.drift).max() < 2e-3


def test_drift_is_followed_slowly_and_a_pose_that_is_kept_is_not():
    tracker = RestTracker(SPAN, R0)
    drift = 0.1 * SPAN
    told, t = feed(tracker, 60, lambda t: drift, 0.0)
    assert told.ohms == pytest.approx(R0 * (1 + drift), rel=2e-3)
    assert told.drift == pytest.approx(drift, rel=0.1)
    before = told.ohms
    told, _ = feed(tracker, 30, lambda t: drift + 0.5 * SPAN, t)
    assert told.ohms == pytest.approx(before, rel=1e-4)
    assert not told.resting


def test_a_lost_channel_does_not_keep_the_others_from_being_followed():
    tracker = RestTracker(SPAN, R0)
    for k in range(round(60 * RATE)):
        told = tracker(k / RATE, np.array([np.inf, 400.0 * 1.008]), frozenset({0}))
    assert told.ohms[0] == R0[0]
    assert told.ohms[1] == pytest.approx(400 * 1.008, rel=1e-3)


def test_a_user_may_say_that_it_rests_now():
    tracker = RestTracker(SPAN)
    feed(tracker, 1, lambda t: SPAN * np.sin(3 * t), 0.0)
    tracker.set_now()
    told, _ = feed(tracker, 0.1, lambda t: 0.5 * SPAN, 1.0)
    assert told.ohms is not None
    assert told.settled


def test_drift_is_told_from_one_per_cent_on():
    assert drift_told(("a", "b"), np.array([0.004, -0.002])) is None
    assert "a by +2.0 %" in drift_told(("a", "b"), np.array([0.02, -0.002]))


def test_what_the_training_began_with_is_taken_out_from_the_beginning():
    lying = np.array([-0.03, -0.015])
    tracker = RestTracker(SPAN, lying=lying)
    told, t = feed(tracker, 3, lambda t: lying, 0.0)
    assert told.ohms == pytest.approx(R0, rel=1e-3)
    told, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), t)
    told, _ = feed(tracker, 5, still, t)
    assert told.settled
    assert told.ohms == pytest.approx(R0, rel=1e-3)


def test_a_pause_in_a_pose_counts_no_more_than_it_lasts():
    """Two seconds near the rest, and then ten at it."""
    tracker = RestTracker(SPAN, lying=np.zeros(2))
    _, t = feed(tracker, 3, still, 0.0)
    _, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), t)
    paused, t = feed(tracker, 3, lambda t: 0.12 * SPAN, t)
    assert (np.abs(paused.ohms / R0 - 1) < 0.06 * SPAN).all()
    _, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), t)
    told, _ = feed(tracker, 10, still, t)
    assert (np.abs(told.ohms / R0 - 1) < 0.02 * SPAN).all()
