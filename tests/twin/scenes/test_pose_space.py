"""Shapes between solved states."""

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.scenes.pose_space import PoseSpace
from tests.errors import raises

OPPOSITE = np.array([[-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])  # up, down, twist


def states(count, rng):
    w = rng.uniform(0, 1.1, (count, 3))
    w[::2, 0] = 0.0
    w[1::2, 1] = 0.0
    return w


def bent(w):
    """Places (n, 2, 3) mm of a bar's end that is bent and twisted by angles."""
    a, b = 0.5 * (w[:, 1] - w[:, 0]), 0.8 * w[:, 2]
    x = np.stack([100 * np.sin(a), 100 * (1 - np.cos(a)), 15 * np.sin(b) * np.cos(a)], axis=1)
    return np.stack([x, 0.5 * x * np.cos(b)[:, None]], axis=1)


def test_states_are_reproduced_and_rest_is_rest():
    w = states(30, np.random.default_rng(0))
    space = PoseSpace(OPPOSITE, w)
    assert space(w) == pytest.approx(np.eye(30), abs=1e-8)
    assert space(np.zeros((1, 3))) == pytest.approx(np.zeros((1, 30)), abs=1e-8)


def test_opposite_poses_take_back_each_other():
    space = PoseSpace(OPPOSITE, states(30, np.random.default_rng(0)))
    both, one = space(np.array([[0.9, 0.4, 0.3], [0.5, 0.0, 0.3]]))
    assert both == pytest.approx(one)


def test_between_states_it_is_right_and_says_how_far_it_is_off():
    rng = np.random.default_rng(0)
    w = states(45, rng)
    values = bent(w)
    space = PoseSpace(OPPOSITE, w)
    fresh = 0.9 * states(200, rng)
    off = (space(fresh) @ values.reshape(45, -1)).reshape(200, 2, 3) - bent(fresh)
    true = np.sqrt((off**2).sum(-1).mean())
    groups = np.repeat(np.arange(15), 3)
    groups[np.linalg.norm(w @ OPPOSITE.T, axis=1) > 1.05] = -1
    left, which = space.left_out(values, groups)
    told = np.sqrt((left**2).sum(-1).mean())
    assert true < 0.1
    assert 0.3 * true < told < 6 * true
    assert np.array_equal(which, np.flatnonzero(groups >= 0))
    assert left.shape == (len(which), 2, 3)


def test_states_that_are_left_out_are_told_by_the_others_alone():
    rng = np.random.default_rng(0)
    w = states(30, rng)
    values = bent(w)
    values[7] += 5.0
    off, which = PoseSpace(OPPOSITE, w).left_out(values, np.where(np.arange(30) == 7, 0, -1))
    assert which.tolist() == [7]
    assert off[0] == pytest.approx(np.full((2, 3), -5.0), abs=0.5)


def test_terms_that_no_state_tells_apart_are_left_out():
    """Two poses that are never mixed: their product is no term, and nothing is singular."""
    levels = np.linspace(0.1, 1.1, 12)[:, None]
    w = np.concatenate([levels * [1.0, 0.0], levels * [0.0, 1.0]])
    space = PoseSpace(np.eye(2), w)
    assert space(w) == pytest.approx(np.eye(24), abs=1e-7)


def test_too_few_states_are_refused():
    with raises(CaptureError, "states-too-few", states=2, axes=2):
        PoseSpace(OPPOSITE, np.eye(3)[:2])
