"""R0 is measured first, again once rubber has set, and follows drift but not poses."""

import numpy as np
import pytest

from defsense_fab.runtime.frames.rest_tracker import RestTracker, drift_note

SPAN = np.array([0.2, 0.1])
R0 = np.array([1500.0, 400.0])
RATE = 60.0


def feed(tracker, seconds, level, begin, rng=None, noise=1e-3):
    """Feed signals `level(t)` (2,) from the time `begin`; return the last rest and the end time."""
    rng = rng or np.random.default_rng(0)
    out = None
    for k in range(round(seconds * RATE)):
        t = k / RATE
        ohms = R0 * (1 + np.asarray(level(t)) + noise * SPAN * 10 * rng.normal(size=2) / 10)
        out = tracker(begin + t, ohms)
    return out, begin + seconds


def still(t):
    return 0.0, 0.0


def test_rest_is_the_median_of_the_first_still_period():
    tracker = RestTracker(SPAN)
    rest, t = feed(tracker, 5, lambda t: SPAN * np.sin(3 * t), 0.0)
    assert rest.ohms is None
    rest, _ = feed(tracker, 2, still, t)
    assert rest.ohms == pytest.approx(R0, rel=1e-3)
    assert rest.is_resting


class NoisyDevice:
    """A device whose slow noise is larger than a small share of its channels' ranges.

    The last channel hardly changes in any pose.
    """

    span = np.array([0.13, 0.05, 1e-6])
    ohms = np.array([1500.0, 350.0, 1600.0])

    def __init__(self, noise=1.0):
        self.rng, self.noise = np.random.default_rng(4), noise
        self.tracker, self.slow, self.time = RestTracker(self.span), np.zeros(3), 0.0

    def move(self, seconds, level):
        """Return the rests while the device is at `level(t)` of its ranges."""
        rests = []
        for k in range(round(seconds * RATE)):
            self.time += 1 / RATE
            drawn = self.noise * self.rng.normal(size=(2, 3))
            self.slow += (drawn[0] * [3e-3, 1e-2, 3e-3] - self.slow) * 10 / RATE
            signals = level(k / RATE) * self.span + self.slow + 1e-3 * drawn[1]
            rests.append(self.tracker(self.time, self.ohms * (1 + signals)))
        return rests


def test_noisy_and_silent_channels_do_not_prevent_a_rest():
    device = NoisyDevice()
    rest = device.move(6, lambda _: 0.0)[-1]
    assert rest.ohms == pytest.approx(device.ohms, rel=4e-3)
    rests = device.move(12, lambda t: np.sin(2 * t))
    assert not any(r.is_resting for r in rests[120:])
    rest = device.move(30, lambda _: 0.0)[-1]
    assert rest.has_settled
    assert rest.ohms == pytest.approx(device.ohms, rel=4e-3)


@pytest.mark.parametrize("noise", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("speed", [0.5, 1.0, 3.0])
def test_movements_are_no_first_rest(noise, speed):
    rests = NoisyDevice(noise).move(15, lambda t: np.sin(speed * t))
    assert all(rest.ohms is None for rest in rests)


def test_first_rest_after_movement_sets_rest_and_resets_drift():
    tracker = RestTracker(SPAN)
    _, t = feed(tracker, 3, still, 0.0)
    rest, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), t)
    assert not rest.has_settled
    after_setting = 0.12 * SPAN  # what the first cycles leave
    rest, t = feed(tracker, 5, lambda t: after_setting, t)
    assert rest.has_settled
    assert rest.ohms == pytest.approx(R0 * (1 + after_setting), rel=2e-3)
    assert np.abs(rest.drift).max() < 2e-3


def test_drift_is_followed_but_a_held_pose_is_not():
    tracker = RestTracker(SPAN, R0)
    drift = 0.1 * SPAN
    rest, t = feed(tracker, 60, lambda t: drift, 0.0)
    assert rest.ohms == pytest.approx(R0 * (1 + drift), rel=2e-3)
    assert rest.drift == pytest.approx(drift, rel=0.1)
    before = rest.ohms
    rest, _ = feed(tracker, 30, lambda t: drift + 0.5 * SPAN, t)
    assert rest.ohms == pytest.approx(before, rel=1e-4)
    assert not rest.is_resting


def test_other_channels_are_followed_while_one_is_lost():
    tracker = RestTracker(SPAN, R0)
    for k in range(round(60 * RATE)):
        rest = tracker(k / RATE, np.array([np.inf, 400.0 * 1.008]), frozenset({0}))
    assert rest.ohms[0] == R0[0]
    assert rest.ohms[1] == pytest.approx(400 * 1.008, rel=1e-3)


def test_user_can_set_the_rest():
    tracker = RestTracker(SPAN)
    feed(tracker, 1, lambda t: SPAN * np.sin(3 * t), 0.0)
    tracker.set_now()
    rest, _ = feed(tracker, 0.1, lambda t: 0.5 * SPAN, 1.0)
    assert rest.ohms is not None
    assert rest.has_settled


def test_drift_is_reported_from_one_per_cent():
    assert drift_note(("a", "b"), np.array([0.004, -0.002])) is None
    note = drift_note(("a", "b"), np.array([0.02, -0.002]))
    assert (note.code, note.data) == ("rest-drifted", {"a": 0.02})


def test_first_rest_of_the_training_is_removed_from_the_start():
    first_rest = np.array([-0.03, -0.015])
    tracker = RestTracker(SPAN, first_rest_signals=first_rest)
    rest, t = feed(tracker, 3, lambda t: first_rest, 0.0)
    assert rest.ohms == pytest.approx(R0, rel=1e-3)
    rest, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), t)
    rest, _ = feed(tracker, 5, still, t)
    assert rest.has_settled
    assert rest.ohms == pytest.approx(R0, rel=1e-3)


def test_signals_that_cords_remember_are_no_drift():
    remembered = 0.1 * SPAN
    tracker = RestTracker(SPAN, R0, rest_signals=lambda _: remembered)
    _, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), 0.0)
    rest, t = feed(tracker, 40, lambda t: remembered, t)
    assert rest.ohms == pytest.approx(R0, rel=1e-3)
    tracker.set_now()
    assert tracker.rest.ohms == pytest.approx(R0, rel=2e-3)
    drift = 0.1 * SPAN
    rest, _ = feed(tracker, 60, lambda t: (1 + remembered) * (1 + drift) - 1, t)
    assert rest.ohms == pytest.approx(R0 * (1 + drift), rel=5e-3)


def test_rest_that_a_decoder_does_not_know_is_not_followed():
    tracker = RestTracker(SPAN, R0, rest_signals=lambda _: np.full(2, np.nan))
    _, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), 0.0)
    rest, _ = feed(tracker, 40, lambda t: 0.1 * SPAN, t)
    assert rest.ohms == pytest.approx(R0, rel=1e-3)
    assert not rest.is_resting


def test_short_pause_near_rest_has_little_weight():
    """Pause two seconds near the rest, then rest for ten."""
    tracker = RestTracker(SPAN, first_rest_signals=np.zeros(2))
    _, t = feed(tracker, 3, still, 0.0)
    _, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), t)
    paused, t = feed(tracker, 3, lambda t: 0.12 * SPAN, t)
    assert (np.abs(paused.ohms / R0 - 1) < 0.06 * SPAN).all()
    _, t = feed(tracker, 4, lambda t: 0.8 * SPAN * np.sin(2 * t), t)
    rest, _ = feed(tracker, 10, still, t)
    assert (np.abs(rest.ohms / R0 - 1) < 0.02 * SPAN).all()
