"""Interpolation of shapes between simulated states."""

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.scenes.pose_space import PoseSpace
from tests.support.errors import raises

OPPOSITE = np.array([[-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])  # up, down, twist


def draw_states(count, rng):
    w = rng.uniform(0, 1.1, (count, 3))
    w[::2, 0] = 0.0
    w[1::2, 1] = 0.0
    return w


def bent(w):
    """Return points (n, 2, 3) mm of the end of a bar that is bent and twisted."""
    a, b = 0.5 * (w[:, 1] - w[:, 0]), 0.8 * w[:, 2]
    x = np.stack([100 * np.sin(a), 100 * (1 - np.cos(a)), 15 * np.sin(b) * np.cos(a)], axis=1)
    return np.stack([x, 0.5 * x * np.cos(b)[:, None]], axis=1)


def test_states_and_rest_are_reproduced():
    w = draw_states(30, np.random.default_rng(0))
    space = PoseSpace(OPPOSITE, w)
    assert space(w) == pytest.approx(np.eye(30), abs=1e-8)
    assert space(np.zeros((1, 3))) == pytest.approx(np.zeros((1, 30)), abs=1e-8)


def test_opposite_poses_cancel_each_other():
    space = PoseSpace(OPPOSITE, draw_states(30, np.random.default_rng(0)))
    both, one = space(np.array([[0.9, 0.4, 0.3], [0.5, 0.0, 0.3]]))
    assert both == pytest.approx(one)


def test_cross_validation_estimates_the_interpolation_error():
    rng = np.random.default_rng(0)
    w = draw_states(45, rng)
    values = bent(w)
    space = PoseSpace(OPPOSITE, w)
    new = 0.9 * draw_states(200, rng)
    error = (space(new) @ values.reshape(45, -1)).reshape(200, 2, 3) - bent(new)
    true = np.sqrt((error**2).sum(-1).mean())
    groups = np.repeat(np.arange(15), 3)
    groups[np.linalg.norm(w @ OPPOSITE.T, axis=1) > 1.05] = -1
    residuals, indices = space.predict_left_out(values, groups)
    estimate = np.sqrt((residuals**2).sum(-1).mean())
    assert true < 0.1
    assert 0.3 * true < estimate < 6 * true
    assert np.array_equal(indices, np.flatnonzero(groups >= 0))
    assert residuals.shape == (len(indices), 2, 3)


def test_left_out_state_is_predicted_from_the_others_alone():
    rng = np.random.default_rng(0)
    w = draw_states(30, rng)
    values = bent(w)
    values[7] += 5.0
    errors, indices = PoseSpace(OPPOSITE, w).predict_left_out(
        values, np.where(np.arange(30) == 7, 0, -1)
    )
    assert indices.tolist() == [7]
    assert errors[0] == pytest.approx(np.full((2, 3), -5.0), abs=0.5)


def test_dependent_polynomial_terms_are_dropped():
    """The product of two poses that are never mixed is no term; the system is not singular."""
    levels = np.linspace(0.1, 1.1, 12)[:, None]
    w = np.concatenate([levels * [1.0, 0.0], levels * [0.0, 1.0]])
    space = PoseSpace(np.eye(2), w)
    assert space(w) == pytest.approx(np.eye(24), abs=1e-7)


def test_too_few_states_are_rejected():
    with raises(CaptureError, "too-few-states", states=2, axes=2):
        PoseSpace(OPPOSITE, np.eye(3)[:2])
