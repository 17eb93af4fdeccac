"""Cords that break a limit are moved as little as possible until they keep all of them."""

from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.curve import REST_FRAME, Hermite, Plane, catmull_rom, sample_path
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.regions import Box
from defsense_fab.core.errors import LayoutError
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.limits.worsening import worsened_limits
from defsense_fab.optimization.prediction.design_task import layout_limits
from defsense_fab.optimization.refinement import repair as repair_module
from defsense_fab.optimization.refinement.repair import repair_layout
from defsense_fab.store.build import Build
from defsense_fab.workflow.build.build import build_body
from tests.optimization.conftest import LIMITS
from tests.support.errors import raises

DEVICES = Path(__file__).parents[3] / "fixtures" / "devices"
X = np.array([2.0, 10, 36, 62, 88, 114, 140, 148])


def cord(name="a", y=0.0, z=0.0, moves=()):
    """Return a cord along the bar, some of whose points (index, x, y) are moved."""
    points = np.stack([X, np.full(len(X), y)], axis=1)
    for index, dx, dy in moves:
        points[index] += dx, dy
    plane = Plane.from_normal(np.array([0, 0, z]), np.eye(3)[2], np.eye(3)[0])
    return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset({"path"}))


def codes(surface, *sensors, limits=LIMITS):
    return [v.code for v in verify(sensors, surface, limits).violations]


@pytest.mark.parametrize(
    ("broken", "code"),
    [
        (cord(y=12.71), "wall-too-thin"),
        (cord(moves=[(3, 0, 9), (4, -22, 2)]), "bend-too-tight"),
        (cord(moves=[(0, -6, 0)]), "path-leaves-body"),
        (cord(moves=[(0, 30, 0), (1, 30, 0), (2, 20, 0)]), "end-far-from-surface"),
        (cord(y=16.0), "path-leaves-body"),
    ],
)
def test_every_limit_is_repaired(bar, broken, code):
    assert code in codes(bar, broken)
    found = repair_layout([broken], bar, LIMITS)
    assert not codes(bar, *found.sensors)
    assert not found.unrepaired
    assert found.moves["a"] < 32
    assert found.sensors[0].free == broken.free
    assert found.sensors[0].plane.coincides(broken.plane)


def test_a_hundredth_of_a_millimeter_stays_one(bar):
    broken = cord(y=15 - LIMITS.depth + 0.01)
    found = repair_layout([broken], bar, LIMITS)
    assert not found.unrepaired
    assert found.moves["a"] < 0.2


def test_a_repaired_cord_makes_room_for_another(bar):
    layout = [cord("a", y=1.0), cord("b", y=-0.5), cord("c", y=-9.0)]
    assert codes(bar, *layout) == ["cords-too-close"]
    found = repair_layout(layout, bar, LIMITS)
    assert not codes(bar, *found.sensors)
    assert found.sensors[2] is layout[2]


def test_only_the_named_cord_moves(bar):
    layout = [cord("a", y=1.0), cord("b", y=-0.5)]
    found = repair_layout(layout, bar, LIMITS, names=["b"])
    assert found.sensors[0] is layout[0]
    assert not found.unrepaired


def test_tangents_that_follow_from_the_points_keep_following(bar):
    found = repair_layout([cord(y=12.71)], bar, LIMITS).sensors[0].curve
    np.testing.assert_allclose(found.tangents, catmull_rom(found.points), atol=2e-3)


def test_smooth_cords_stay_smooth_in_the_file(bar):
    rng = np.random.default_rng(3)
    for _ in range(12):
        points = np.round(cord(y=8.0).curve.points + rng.normal(0, 3, (len(X), 2)), 3)
        drawn = replace(cord(), curve=Hermite(points, catmull_rom(points)))
        found = repair_layout([drawn], bar, LIMITS).sensors[0].curve
        assert np.array_equal(found.points, np.round(found.points, 3))
        assert np.array_equal(found.tangents, catmull_rom(found.points))


def test_a_repair_ends_when_nobody_wants_it_any_more(bar):
    calls = iter(range(10))

    def check_wanted():
        if next(calls) == 5:
            raise LayoutError("the page was closed", code="cancelled")

    bent = cord(moves=[(3, 0, 9), (4, -22, 2)])
    with raises(LayoutError, "cancelled"):
        repair_layout([bent], bar, LIMITS, check_wanted=check_wanted)


def test_a_repair_whose_time_is_over_keeps_what_it_has_repaired(bar, monkeypatch):
    bent = [(3, 0, 9), (4, -22, 2)]
    layout = [cord("a", z=-5.0, moves=bent), cord("b", z=5.0, moves=bent)]
    assert repair_layout(layout, bar, LIMITS).is_complete
    calls = count()
    repair_layout(layout, bar, LIMITS, names=["a"], check_wanted=lambda: next(calls))
    clock = count()
    monkeypatch.setattr(repair_module, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    found = repair_layout(layout, bar, LIMITS, limit_s=next(calls) + 1)
    assert not found.is_complete
    assert found.moves.keys() == {"a"}
    assert found.unrepaired == ("b",)
    assert found.sensors[1] is layout[1]


def test_only_what_a_search_may_move_is_moved(bar):
    bent = cord(moves=[(3, 0, 9), (4, -22, 2)])
    assert codes(bar, bent)
    (found,) = repair_layout([bent], bar, LIMITS, keeps_freedoms=True).sensors
    assert not codes(bar, found)
    assert found.plane is bent.plane
    np.testing.assert_allclose(found.curve.points[[0, -1]], bent.curve.points[[0, -1]], atol=1e-4)
    above = cord(z=17.0)
    assert repair_layout([above], bar, LIMITS, keeps_freedoms=True).unrepaired == ("a",)
    assert not repair_layout([above], bar, LIMITS).unrepaired


def test_cords_in_one_plane_stay_in_it_in_a_repair_for_a_search(bar):
    kept = Box(np.array([60.0, -6, -2]), np.array([70.0, 15, 2]))
    limits, free = replace(LIMITS, kept_whole=(kept,)), frozenset({"path", "plane"})
    layout = [replace(cord("a", y=3.0), free=free), replace(cord("b", y=-10.0), free=free)]
    a, b = repair_layout(layout, bar, limits, keeps_freedoms=True).sensors
    assert a.plane.coincides(b.plane)
    assert not repair_layout(layout, bar, limits).unrepaired


@pytest.mark.parametrize("freedom", ["plane", "offset"])
def test_a_free_plane_is_moved_in_a_repair(bar, freedom):
    plane = Plane.from_normal(np.array([0, 0, 13.5]), np.array([0, 0.01, 1]), np.eye(3)[0])
    low = replace(cord(), plane=plane, free=frozenset({"path", freedom}))
    assert codes(bar, low)
    (found,) = repair_layout([low], bar, LIMITS, keeps_freedoms=True).sensors
    assert not codes(bar, found)
    assert found.plane.origin[2] < 13.5
    if freedom == "offset":
        np.testing.assert_allclose(found.plane.normal, plane.normal, atol=1e-9)


def test_pads_of_cords_that_stay_do_not_prevent_a_repair(bar):
    def trace(name, y, z):
        points = np.stack([X, np.full(len(X), y), np.full(len(X), z)], axis=1)
        return Sensor(name, REST_FRAME, Hermite(points, catmull_rom(points)), frozenset())

    limits = replace(LIMITS, pad=(4.0, 3.0), is_cut=False)
    layout = [trace("a", 1.0, 0.0), trace("b", -3.0, 0.0), trace("c", 0.0, 14.5)]
    found = repair_layout(layout, bar, limits, names=["c"])
    assert "pad-too-close" in [v.code for v in found.check.violations]
    assert set(found.moves) == {"c"}
    assert not found.unrepaired


def test_a_path_in_space_is_repaired(bar):
    points = np.stack([X, 13 * np.sin(X / 25), 13 * np.cos(X / 25)], axis=1)
    broken = Sensor("a", REST_FRAME, Hermite(points, catmull_rom(points)), frozenset({"path"}))
    assert codes(bar, broken)
    found = repair_layout([broken], bar, LIMITS)
    assert not codes(bar, *found.sensors)
    assert not found.sensors[0].curve.is_planar


def test_what_cannot_be_repaired_is_reported_and_nothing_gets_worse(bar):
    limits = replace(LIMITS, wall=14.5)
    layout = [cord("a", y=1.0)]
    found = repair_layout(layout, bar, limits)
    assert found.unrepaired == ("a",)
    before = verify(layout, bar, limits)
    assert not worsened_limits(before, found.check, limits)


def test_a_layout_within_all_limits_stays(bar):
    layout = (cord("a"),)
    found = repair_layout(layout, bar, LIMITS)
    assert found.sensors == layout
    assert not found.moves


def break_cord(sensor, rng):
    """Return a cord after a random edit: of all points, one point, a tangent or the plane."""
    points, tangents, plane = sensor.curve.points.copy(), sensor.curve.tangents.copy(), sensor.plane
    k, size = rng.integers(len(points)), rng.uniform(2, 10)
    kind = rng.integers(4)
    if kind == 0:
        points += rng.normal(0, size / 2, points.shape)
        tangents = catmull_rom(points)
    elif kind == 1:
        points[k] += rng.normal(0, size, points.shape[1])
        tangents = catmull_rom(points)
    elif kind == 2:
        tangents[k] = rng.uniform(-0.5, 2) * tangents[k] + rng.normal(0, 2 * size, points.shape[1])
    else:
        normal = plane.normal + rng.normal(0, 0.2, 3)
        origin = plane.origin + rng.normal(0, size / 2, 3)
        plane = Plane.from_normal(origin, normal, plane.axes[:, 0])
    return replace(sensor, plane=plane, curve=Hermite(points, tangents))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bar", "twist-bar", "joystick"])
def test_most_random_edits_are_repaired(name, tmp_path):
    device = load_device(DEVICES / name)
    build_body(device, tmp_path / "body", lambda *_: None)
    surface, limits = Build(tmp_path / "body").surface, layout_limits(device)
    rng, repaired, count = np.random.default_rng(0), 0, 0
    while count < 8:
        layout = list(device.sensors)
        k = int(rng.integers(len(layout)))
        layout[k] = break_cord(layout[k], rng)
        before = verify(layout, surface, limits)
        if not before.violations:
            continue
        count += 1
        found = repair_layout(layout, surface, limits)
        repaired += not found.unrepaired
        assert not worsened_limits(before, found.check, limits)
        for old, new in zip(layout, found.sensors, strict=True):
            assert (new is old) == (new.name not in found.moves)
            assert np.isfinite(sample_path(new)).all()
    assert repaired >= 0.9 * count
