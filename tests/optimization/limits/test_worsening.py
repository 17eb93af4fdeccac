"""A changed layout is worse only if a limit is broken more often, or further, than before."""

from dataclasses import replace

import numpy as np

from defsense_fab.core.curve import REST_FRAME, Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.device.regions import Box
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.limits.worsening import worsened_limits
from defsense_fab.optimization.refinement.repair import repair_layout
from tests.optimization.conftest import LIMITS

X = np.array([2.0, 10, 36, 62, 88, 114, 140, 148])
KEPT = replace(
    LIMITS,
    kept_whole=(
        Box(np.array([20.0, -3, -3]), np.array([30.0, 3, 3])),
        Box(np.array([100.0, 0.5, 0.5]), np.array([110.0, 3, 3])),
    ),
)
TRACES = replace(LIMITS, pad=(4.0, 3.0), is_cut=False)


def cord(name="a", y=0.0, plane=REST_FRAME):
    points = np.stack([X, np.full(len(X), y)], axis=1)
    return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset({"path"}))


def trace(name, y):
    points = np.stack([X, np.full(len(X), y), np.zeros(len(X))], axis=1)
    return Sensor(name, REST_FRAME, Hermite(points, catmull_rom(points)), frozenset())


def test_a_layout_that_breaks_a_limit_at_several_places_is_not_worse_than_itself(bar):
    for layout, limits in (([cord()], KEPT), ([trace("a", 1.0), trace("b", -3.0)], TRACES)):
        check = verify(layout, bar, limits)
        keys = [(v.code, v.cords) for v in check.violations]
        assert len(set(keys)) < len(keys)
        assert not worsened_limits(check, check, limits)


def test_the_lesser_of_two_broken_limits_may_not_get_worse(bar):
    far, near = KEPT.kept_whole[1], Box(np.array([100.0, -1, -1]), np.array([110.0, 3, 3]))
    limits = replace(KEPT, kept_whole=(far, KEPT.kept_whole[0]))
    before = verify([cord()], bar, limits)
    after = verify([cord()], bar, replace(limits, kept_whole=(near, KEPT.kept_whole[0])))
    assert "kept-region-crossed" in [v.code for v in worsened_limits(before, after, limits)]
    assert not worsened_limits(after, before, limits)


def test_a_second_end_outside_the_exits_is_new(bar):
    start = Box(np.array([-1.0, -5, -5]), np.array([1.0, 5, 5]))
    end = Box(np.array([149.0, -5, -5]), np.array([151.0, 5, 5]))
    one = verify([cord()], bar, replace(LIMITS, exits=(start,)))
    both = verify([cord()], bar, replace(LIMITS, exits=(end,)))
    assert len(one.violations) == len(both.violations) == 1
    elsewhere = Box(np.array([70.0, 14, -5]), np.array([80.0, 16, 5]))
    limits = replace(LIMITS, exits=(elsewhere,))
    two = verify([cord()], bar, limits)
    assert len(two.violations) == 2
    assert [v.code for v in worsened_limits(one, two, limits)] == ["exit-not-allowed"]


def test_a_cord_is_repaired_next_to_one_that_crosses_two_kept_regions(bar):
    up = Plane.from_normal(np.zeros(3), np.eye(3)[2], np.eye(3)[0])
    layout = [cord(), cord("c", -12.71, up)]
    found = repair_layout(layout, bar, KEPT, names=["c"])
    assert set(found.moves) == {"c"}
    assert not found.unrepaired
