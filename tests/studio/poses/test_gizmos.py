"""Rotations as hands make them, and what a pose is then."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.device.device_file import parse_device
from defsense_fab.studio.edits.poses import drag_point
from defsense_fab.studio.poses.gizmos import (
    edits_of,
    grips_of,
    quaternion,
    rotation_vector,
    tidy,
    with_grip,
)
from defsense_fab.studio.poses.pose_part import FREE, HELD, MOVED, TURNED, role_edits, role_of
from tests.studio.devices import TEXT, write_device

POINTS = np.array(
    [[x, y, z] for x in (0.0, 5, 75, 142, 150) for y in (-15.0, 15) for z in (-15.0, 15)]
)


@pytest.fixture
def device(tmp_path):
    return parse_device(TEXT, write_device(tmp_path))


def test_a_hand_may_turn_beyond_half_a_turn():
    axis, near = np.array([0.6, 0.0, 0.8]), np.zeros(3)
    for degrees in (100, 170, 190, 300, 370, 350, 180, 10, 0, -20, -200):
        goal = np.deg2rad(degrees) * axis
        near = rotation_vector(np.array(quaternion(goal)), near)
        assert near == pytest.approx(goal, abs=1e-9)


def test_rotations_are_written_as_a_person_would():
    axis, degrees = tidy(np.deg2rad(-31.234) * np.array([0.001, 0.9999995, 0.0]))
    assert axis.tolist() == [0, 1, 0]
    assert degrees == pytest.approx(-31.2)
    axis, degrees = tidy(np.deg2rad(20) * np.array([0.6, 0.8, 0]))
    assert axis == pytest.approx([0.6, 0.8, 0])
    assert degrees == 20
    assert tidy(np.zeros(3))[1] == 0


def test_grips_are_where_regions_lie(device):
    bend, twist = device.poses
    (grip,) = grips_of(bend, device, POINTS, {})
    assert (grip.name, grip.shifts, grip.turns) == ("tip", False, True)
    assert grip.position.tolist() == [146, 0, 0]
    (carried,) = grips_of(bend, device, POINTS, {"tip": np.array([140.0, 0, 20])})
    assert carried.position.tolist() == [140, 0, 20]
    (fixed,) = grips_of(twist, device, POINTS, {"tip": np.array([140.0, 0, 20])})
    assert fixed.shifts
    assert fixed.position.tolist() == [145, 0, 0]  # about which it turns


def test_what_a_hand_does_becomes_one_edit(device):
    bend, twist = device.poses
    turn = np.deg2rad(-40) * np.array([0, 1.0, 0])
    after = with_grip(bend, device, POINTS, "tip", np.array([1.0, 2, 3]), turn)
    assert np.isnan(after.handles[0].translation).all()  # its place is free
    assert [e.name for e in edits_of(bend, after)] == ["turn `tip` in `bend`"]
    handle = twist.handles[0]
    shifted = with_grip(twist, device, POINTS, "tip", np.array([145.0, 0, 7]), handle.rotation)
    assert shifted.handles[0].translation.tolist() == [0, 0, 7]
    assert [e.name for e in edits_of(twist, shifted)] == ["move `tip` in `twist`"]
    assert edits_of(twist, with_grip(twist, device, POINTS, "gone", np.zeros(3), turn)) == []


def test_a_point_that_is_pulled_has_a_grip_at_its_goal(device):
    import tomlkit

    document = tomlkit.parse(TEXT)
    drag_point("bend", np.array([75.0, 0, 15]), np.array([0, 0, 9.0]), 1.0).change(document)
    pulled = parse_device(tomlkit.dumps(document), device.source)
    bend = pulled.poses[0]
    grip = grips_of(bend, pulled, POINTS, {})[-1]
    assert grip.position.tolist() == [75, 0, 24]
    assert not grip.turns
    after = with_grip(bend, pulled, POINTS, grip.name, np.array([75.0, 4, 24]), np.zeros(3))
    assert after.drags[0].by.tolist() == [0, 4, 9]
    assert [e.name for e in edits_of(bend, after)] == ["move a pull in `bend`"]


def test_roles_are_read_and_written(device):
    bend, twist = device.poses
    assert [role_of(bend, n) for n in ("base", "tip", "other")] == [HELD, TURNED, FREE]
    assert role_of(twist, "tip") == MOVED
    assert role_edits(bend, "tip", TURNED, [0, 0, 0]) == []
    names = {
        role: [e.name for e in role_edits(bend, "tip", role, [1.0, 0, 0])]
        for role in (FREE, HELD, MOVED)
    }
    assert names == {
        FREE: ["leave `tip` in `bend`"],
        HELD: ["hold `tip` in `bend`"],
        MOVED: ["move `tip` in `bend`"],
    }
    assert [e.name for e in role_edits(bend, "base", MOVED, [0, 0, 0])] == [
        "move `base` in `bend`", "move `base` in `bend`"
    ]  # fmt: skip
    assert len(role_edits(bend, "base", TURNED, [0, 0, 0])) == 1
