"""Cords of a simulated device repeat its session, or follow a person's hand."""

import numpy as np
import pytest

from defsense_fab.twin.electronics.cords import CUT, OPEN_OHM, CordFault
from defsense_fab.twin.electronics.rubber_cords import MemoryTraits, RubberPieces, RubberTraits
from defsense_fab.twin.recordings.bent_cords import MAX_TOTAL_LEVEL, BentCords
from defsense_fab.twin.recordings.twin_recordings import Truth

TIME = np.linspace(0, 20, 2001)
GAINS = np.array([[0.1, -0.05], [0.0, 0.2], [0.3, 0.3]])  # of the poses (3) in the cords (2)
REST = np.array([1000.0, 2000.0])
REST_SAMPLES = 100  # 1 s
NO_MEMORY = MemoryTraits(tear=(0.0, 0.0, 0.0), friction=0.0, mullins=0.0)


def signals_at(levels):
    return levels @ GAINS


def make_cords(memory):
    weights = np.zeros((len(TIME), 3))
    weights[REST_SAMPLES:, 0] = np.linspace(0, 1, len(TIME) - REST_SAMPLES + 1)[1:]
    weights[1500:, 1] = np.linspace(0, 1, 501)
    signals = signals_at(weights)
    truth = Truth(TIME, np.zeros((0, 0, 3)), TIME, weights, signals, REST * (1 + signals))
    faults = (CordFault(CUT, (1,), 15.0),)
    pieces = RubberPieces(RubberTraits(memory), REST, np.zeros(2), np.empty((2, 0)))
    return BentCords(("a", "b"), truth, ("bend", "twist"), signals_at, pieces, faults)


@pytest.fixture
def cords():
    return make_cords(NO_MEMORY)


def hold(cords, start, seconds=2.0, step=0.01):
    return [cords.sample(start + k * step, step) for k in range(round(seconds / step))][-1]


def test_the_session_is_repeated_until_somebody_bends(cords):
    np.testing.assert_allclose(hold(cords, 0.0, 0.9), REST)
    cords.bend({"bend": 1.0})
    np.testing.assert_allclose(hold(cords, 1.0), REST * (1 + GAINS[0]), rtol=1e-3)
    cords.bend({"twist": 0.5})
    np.testing.assert_allclose(hold(cords, 3.0), REST * (1 + GAINS[1] / 2), rtol=1e-3)
    cords.bend({})
    np.testing.assert_allclose(hold(cords, 5.0), REST, rtol=1e-3)
    cords.bend(None)
    np.testing.assert_allclose(cords.sample(0.2, 0.5), REST)


def test_nobody_bends_the_cords_in_the_first_rest(cords):
    cords.bend({"bend": 1.0})
    np.testing.assert_allclose(hold(cords, 0.0, 0.9), REST)
    np.testing.assert_allclose(hold(cords, 1.0), REST * (1 + GAINS[0]), rtol=1e-3)


def test_the_body_follows_smoothly(cords):
    cords.sample(0.99, 0.01)
    cords.bend({"bend": 1.0})
    first = cords.sample(1.0, 0.01)
    assert REST[0] < first[0] < REST[0] * (1 + 0.2 * GAINS[0, 0])


def test_levels_are_limited_and_unknown_poses_are_ignored(cords):
    cords.bend({"bend": 7.0, "twist": 7.0, "other": 1.0})
    expected = REST * (1 + (GAINS[0] + GAINS[1]) * MAX_TOTAL_LEVEL / 2)
    np.testing.assert_allclose(hold(cords, 1.0), expected, rtol=1e-3)


def test_faults_remain_while_somebody_bends(cords):
    cords.bend({"bend": 1.0})
    assert hold(cords, 15.0)[1] == OPEN_OHM


def test_cords_go_on_from_where_the_session_left_them(cords):
    before = cords.sample(10.0, 0.01)
    cords.bend({})
    assert cords.sample(10.01, 0.01) == pytest.approx(before, rel=1e-3)
    assert hold(cords, 10.02) == pytest.approx(REST, rel=1e-3)


def test_levels_are_those_of_the_session_or_of_the_hand(cords):
    cords.sample(10.0, 0.01)
    assert cords.levels == pytest.approx([9 / 19, 0, 0], abs=2e-3)
    cords.bend({"twist": 0.5})
    hold(cords, 10.01)
    assert cords.levels == pytest.approx([0, 0.5, 0], abs=1e-3)


def test_cords_remember_how_they_were_bent():
    cords = make_cords(MemoryTraits())
    hold(cords, 0.0, 0.9)
    cords.bend({"bend": 1.0})
    bent = hold(cords, 1.0)
    held = hold(cords, 3.0, 30.0)
    assert bent[0] > REST[0] * (1 + 1.05 * GAINS[0, 0]), "stretching adds resistance"
    assert held[0] < bent[0] - 0.005 * REST[0], "that heals"
    cords.bend({})
    assert hold(cords, 33.0)[0] > 1.003 * REST[0], "the cord reads too high after its release"
