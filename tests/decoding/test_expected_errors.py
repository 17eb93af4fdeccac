"""Test the choice of states on which decoders are tested."""

import numpy as np
import pytest

from defsense_fab.decoding.decoders import fit_decoder
from defsense_fab.decoding.expected_errors import (
    HELD_OUT,
    LEFT_OUT,
    MEANING,
    NONE,
    choose_unseen_states,
)

STATES = (
    {},
    {"up": 0.5},
    {"up": 1.0},
    {"down": 0.5},
    {"down": 1.0},
    {"up": 0.5, "down": 0.5},
    {"up": 1.0, "down": 0.3},
)


def test_held_out_states_are_tested_and_not_trained_on():
    held = np.array([False, False, False, False, False, True, True])
    unseen = choose_unseen_states(STATES, held)
    assert unseen.how == HELD_OUT
    ((train, test),) = unseen.folds
    assert train.tolist() == [0, 1, 2, 3, 4]
    assert test.tolist() == unseen.tested.tolist() == [5, 6]


def test_amplitudes_and_mixtures_are_left_out_in_turn():
    unseen = choose_unseen_states(STATES, np.zeros(7, bool))
    assert unseen.how == LEFT_OUT
    assert sorted(test.tolist() for _, test in unseen.folds) == [[1, 3], [2, 4], [5], [6]]
    for train, test in unseen.folds:
        assert sorted([*train, *test]) == list(range(7))
        assert 0 in train  # rest is always trained on
    assert unseen.tested.tolist() == [1, 2, 3, 4, 5, 6]


def test_too_few_states_to_leave_any_out():
    unseen = choose_unseen_states(({}, {"up": 1.0}, {"down": 1.0}), np.zeros(3, bool))
    assert unseen.how == NONE
    assert unseen.tested.tolist() == [0, 1, 2]
    assert set(MEANING) == {HELD_OUT, LEFT_OUT, NONE}


@pytest.mark.parametrize("kind", ["affine", "quadratic", "kernel"])
def test_unseen_states_reveal_a_fit_of_noise(kind):
    """No decoder predicts outputs that are independent of the signals."""
    rng = np.random.default_rng(3)
    signals, outputs = rng.normal(size=(13, 3)), rng.normal(size=(13, 2))
    states = [{}, *({p: a} for p in "abcd" for a in (0.3, 0.6, 1.0))]
    unseen = choose_unseen_states(states, np.zeros(13, bool))
    square = 0.0
    for train, test in unseen.folds:
        decoder = fit_decoder(kind, signals[train], outputs[train], 1e-4)
        square += ((decoder(signals[test]) - outputs[test]) ** 2).sum()
    spread = ((outputs[1:] - outputs.mean(0)) ** 2).sum()
    assert square > 0.8 * spread


def test_order_of_poses_and_zeros_do_not_change_the_path():
    states = ({}, {"a": 0.5, "b": 0.5}, {"b": 1.0, "a": 1.0}, {"a": 1.0, "b": 0}, {"a": 0.5})
    unseen = choose_unseen_states(states, np.zeros(5, bool))
    paths = [(k.tolist(), at.tolist()) for k, at in unseen.paths]
    assert paths == [([1, 2], [0.5, 1.0]), ([3, 4], [1.0, 0.5])]
    assert sorted(test.tolist() for _, test in unseen.folds) == [[1], [2], [3], [4]]


def test_states_on_the_same_loading_path():
    more = {"up": 1.0, "down": 1.0}, {"down": 0.15, "up": 0.5}
    unseen = choose_unseen_states((*STATES, *more), np.zeros(9, bool))
    paths = {tuple(k.tolist()): at.tolist() for k, at in unseen.paths}
    assert paths == {(1, 2): [0.5, 1], (3, 4): [0.5, 1], (5, 7): [0.5, 1], (6, 8): [1, 0.5]}
