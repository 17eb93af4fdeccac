"""The coverage of poses is measured in any position."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.capture.sessions.pose_coverage import BINS, PoseCoverage

REST = np.array([[x, y, 0.0] for x in range(0, 60, 12) for y in (0.0, 15)])


def bent(level):
    out = REST.copy()
    out[:, 2] += 10 * level * (REST[:, 0] / 48) ** 2
    return out


def twisted(level):
    turn = Rotation.from_rotvec(np.outer(0.5 * level * REST[:, 0] / 48, [1, 0, 0]))
    return turn.apply(REST)


@pytest.fixture
def levels():
    steps = np.arange(1, BINS + 1) / BINS
    shapes = np.array([[f(s) for s in steps] for f in (bent, twisted)])
    return PoseCoverage(["bend", "twist"], shapes, REST)


def held(points, seed):
    """Return points in a random position, with noise and three hidden markers."""
    rng = np.random.default_rng(seed)
    moved = Rotation.random(random_state=seed).apply(points) + rng.normal(size=3) * 100
    moved += 0.05 * rng.normal(size=points.shape)
    moved[rng.choice(len(points), 3, replace=False)] = np.nan
    return moved


def test_shapes_are_distinguished_in_any_position(levels):
    for seed, level in enumerate((0.2, 0.41, 0.63)):
        levels.add(held(bent(level), seed))
    levels.add(held(twisted(0.98), 7))
    reached = levels.reached()
    assert reached["bend"][0] == pytest.approx(0.6)
    assert reached["bend"][1].tolist() == [True, True, True, False, False]
    assert reached["twist"][1].tolist() == [False] * 4 + [True]
    assert levels.least_covered() == "twist"


def test_rest_and_other_shapes_are_not_poses(levels):
    levels.add(held(REST, 1))
    levels.add(held(REST * [1, 1.4, 1], 2))
    hidden = np.full(REST.shape, np.nan)
    levels.add(hidden)
    hidden[:, :] = [np.nan] * 3
    hidden[:5] = np.outer(np.arange(5.0), [1, 0, 0])  # on one line
    levels.add(hidden)
    assert all(extent == 0 for extent, _ in levels.reached().values())


def test_parts_seen_before_are_not_new(levels):
    assert levels.add(held(bent(0.41), 1)) == ("bend", 1)
    assert levels.add(held(bent(0.4), 2)) is None
    levels.restore("twist", 3)
    levels.restore("former pose", 0)
    levels.restore("twist", BINS)
    assert levels.add(held(twisted(0.8), 3)) is None
    assert levels.reached()["twist"][1].tolist() == [False, False, False, True, False]
