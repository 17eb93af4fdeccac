"""Faults of cords are detected within a few samples or seconds."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.decoding.channel_faults import FaultLimits
from defsense_fab.runtime.frames.live_faults import LiveFaults

RATE = 100.0
R0 = np.array([1500.0, 1400.0, 420.0])
LIMITS = FaultLimits(
    low=np.full(3, -0.8), high=np.full(3, 0.9), still=np.full(3, 0.6), moves=np.full(3, 0.02),
    jump=np.full(3, 0.02),
)  # fmt: skip


def levels(t):
    return 0.1 * np.sin(np.array([1.1, 1.7, 2.3]) * t)


def faults_after(change, at=3.0, until=12.0, limits=LIMITS):
    """Return the time of the first fault, and the faults at the end.

    Resistances (3,) are changed by `change(t, ohms)` from the time `at`.
    """
    faults, rng, first, now = LiveFaults(limits, 3), np.random.default_rng(1), None, []
    for k in range(round(until * RATE)):
        t = k / RATE
        ohms = R0 * (1 + levels(t) + 5e-4 * rng.normal(size=3))
        if t >= at:
            ohms = change(t, ohms)
        with np.errstate(invalid="ignore"):
            now = faults(t, ohms, ohms / R0 - 1)
        if now and first is None:
            first = t
    return first, [(f.kind, f.channel) for f in now]


def set_to(k, value):
    def change(t, ohms):
        ohms[k] = value
        return ohms

    return change


def test_normal_movement_is_not_a_fault():
    assert faults_after(lambda t, ohms: ohms, until=60.0) == (None, [])


@pytest.mark.parametrize(
    ("value", "kind"), [(np.inf, "torn"), (1e6, "torn"), (0.0, "shorted"), (np.nan, "torn")]
)
def test_open_and_short_circuits_are_reported_in_three_samples(value, kind):
    first, now = faults_after(set_to(1, value))
    assert now == [(kind, 1)]
    assert first < 3.0 + 5 / RATE


def test_open_circuits_are_reported_without_limits():
    assert faults_after(set_to(0, np.inf), limits=None)[1] == [("torn", 0)]


def test_single_glitch_is_ignored_and_repaired_cord_clears_after_a_second():
    glitch = lambda t, ohms: set_to(1, np.inf)(t, ohms) if t < 3.015 else ohms  # noqa: E731
    assert faults_after(glitch)[0] is None
    repaired = lambda t, ohms: set_to(1, np.inf)(t, ohms) if t < 4 else ohms  # noqa: E731
    assert faults_after(repaired, until=4.5)[1] == [("torn", 1)]
    assert faults_after(repaired, until=6.0)[1] == []


def test_constant_channel_is_stuck_while_others_move():
    first, now = faults_after(set_to(2, 431.0))
    assert now == [("stuck", 2)]
    assert first < 3.0 + 2.0


def test_repeating_channel_is_stuck_within_a_fifth_of_a_second():
    """Noise would have changed it, whatever others do. Without that limit it takes longer."""
    limits = replace(LIMITS, repeats=np.full(3, 0.15))
    first, now = faults_after(set_to(1, 1412.0), limits=limits)
    assert 3.15 < first < 3.2
    assert now == [("stuck", 1)]
    assert faults_after(set_to(1, 1412.0))[0] > 3.5
    first, now = faults_after(lambda t, ohms: ohms, limits=limits)
    assert (first, now) == (None, [])
