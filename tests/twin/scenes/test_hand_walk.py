"""Random walks of a hand: steps, speeds, forbidden mixtures and tremor."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.scenes.assumptions import disable_traits
from defsense_fab.twin.scenes.hand_walk import FREE, REST, WalkTraits, plan_walk
from tests.support.errors import raises

NAMES = ("up", "down", "twist")
TOGETHER = np.array([[0, 0, 1], [0, 0, 1], [1, 1, 0]], bool)


def make_walk(seed=0, seconds=120.0, traits=None, **options):
    rng = np.random.default_rng(seed)
    return plan_walk(NAMES, TOGETHER, seconds, rng, traits, **options)


def test_walk_alternates_rest_poses_and_mixtures():
    path = make_walk()
    names = [name for _, name in path.steps]
    assert names[0] == names[-1] == REST
    assert set(names) == {REST, FREE, *NAMES}
    starts = np.array([start for start, _ in path.steps])
    assert (np.diff(starts) > 0).all()
    assert path.times[-1] == pytest.approx(120.0)
    assert (np.diff(path.times) > 0).all()
    ends = np.array([0.0, 4.0, 119.0])
    assert path(ends) == pytest.approx(np.zeros((3, 3)))
    k = names.index("twist")
    t = np.linspace(starts[k] + 4, starts[k + 1] - 0.1, 200)
    assert (path(t)[:, :2] == 0).all()


def test_forbidden_mixtures_never_occur():
    w = make_walk(seconds=600.0)(np.arange(0, 600, 0.02))
    assert (np.minimum(w[:, 0], w[:, 1]) == 0).all()
    assert (np.minimum(w[:, 0], w[:, 2]) > 0.1).any()
    assert (np.minimum(w[:, 1], w[:, 2]) > 0.1).any()
    assert 1.0 < w.max() < 1.1
    assert w.min() >= 0


def test_walk_has_fast_moves_slow_moves_and_pauses():
    path = make_walk(seconds=600.0, traits=disable_traits(WalkTraits(), {"tremor"}))
    t = np.arange(0, 600, 0.01)
    speed = np.abs(np.diff(path(t), axis=0)).max(axis=1) / 0.01
    assert 0.2 < (speed == 0).mean() < 0.7
    assert np.quantile(speed[speed > 0], 0.98) > 4 * np.median(speed[speed > 0])
    assert speed.max() > 2


def test_tremor_is_zero_at_rest():
    shaking, still = make_walk(), make_walk(traits=disable_traits(WalkTraits(), {"tremor"}))
    t = np.arange(0, 120, 0.01)
    assert shaking.keys == pytest.approx(still.keys)
    tremor = shaking(t) - still(t)
    assert 0.001 < np.abs(tremor).max() < 0.06
    assert (tremor[still(t) == 0] == 0).all()


def test_same_seed_gives_the_same_walk():
    assert np.array_equal(make_walk(3).keys, make_walk(3).keys)
    assert (
        make_walk(3).keys.shape != make_walk(4).keys.shape
        or (make_walk(3).keys != make_walk(4).keys).any()
    )


def test_poses_that_are_not_shown_occur_in_mixtures_alone():
    path = make_walk(seconds=400.0, shown=2)
    assert "twist" not in {name for _, name in path.steps}
    assert (path(np.arange(0, 400, 0.1))[:, 2] > 0.1).any()


def test_short_walks_start_and_end_at_rest_and_too_short_ones_are_rejected():
    path = make_walk(seconds=12.0, traits=replace(WalkTraits(), rest=5.0))
    assert path(np.array([0.0, 11.99])) == pytest.approx(np.zeros((2, 3)))
    with raises(CaptureError, "duration-too-short", duration=5.0):
        make_walk(seconds=5.0)
