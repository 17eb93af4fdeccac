"""Points inside a body follow its surface."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.runtime.view.cord_mesh import skinning_weights
from tests.runtime.bars import bent


def skin(rng):
    p = rng.uniform(-1, 1, (1500, 3))
    p /= np.abs(p).max(axis=1, keepdims=True)
    return p * [75, 15, 15] + [75, 0, 0]


def test_affine_movement_is_carried_exactly():
    rng = np.random.default_rng(0)
    vertices = skin(rng)
    inside = rng.uniform([5, -10, -10], [145, 10, 10], (30, 3))
    weights = skinning_weights(inside, vertices)
    assert np.asarray(weights.sum(axis=1)).ravel() == pytest.approx(1)
    R = Rotation.from_rotvec([0.4, -0.8, 0.2]).as_matrix() @ np.diag([1.1, 0.95, 1.0])
    move = lambda p: p @ R.T + [3, 4, -5] - p  # noqa: E731
    assert weights @ move(vertices) == pytest.approx(move(inside), abs=1e-4)


def test_bend_is_carried_within_a_tenth_of_the_motion():
    rng = np.random.default_rng(1)
    vertices = skin(rng)
    inside = rng.uniform([5, -8, -8], [145, 8, 8], (30, 3))
    off = skinning_weights(inside, vertices) @ bent(vertices, 0.5) - bent(inside, 0.5)
    assert np.linalg.norm(off, axis=1).max() < 0.1 * np.abs(bent(inside, 0.5)).max()
