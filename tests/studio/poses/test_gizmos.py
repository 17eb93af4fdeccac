"""Rotations of gizmos, and the grips of a pose."""

from __future__ import annotations

import numpy as np
import pytest
import tomlkit

from defsense_fab.core.device.device_file import parse_device
from defsense_fab.core.rotations import rotation_matrices
from defsense_fab.studio.edits.poses import drag_point, pose_edits
from defsense_fab.studio.poses.grips import move_grip, pose_grips
from defsense_fab.studio.poses.poses_scene import rotation_vector
from defsense_fab.workflow.view import quaternion
from tests.studio.devices import TEXT, write_device

POINTS = np.array(
    [[x, y, z] for x in (0.0, 5, 75, 142, 150) for y in (-15.0, 15) for z in (-15.0, 15)]
)


@pytest.fixture
def device(tmp_path):
    return parse_device(TEXT, write_device(tmp_path))


def test_gizmos_can_be_turned_beyond_half_a_turn():
    axis, previous = np.array([0.6, 0.0, 0.8]), np.zeros(3)
    for degrees in (100, 170, 190, 300, 370, 350, 180, 10, 0, -20, -200):
        goal = np.deg2rad(degrees) * axis
        previous = rotation_vector(np.array(quaternion(rotation_matrices(goal))), previous)
        assert previous == pytest.approx(goal, abs=1e-9)


def test_grips_are_at_the_centers_of_moved_regions(device):
    bend, twist = device.poses
    (grip,) = pose_grips(bend, device, POINTS, {})
    assert (grip.name, grip.can_shift, grip.can_turn) == ("tip", False, True)
    assert grip.position.tolist() == [146, 0, 0]
    solved_centers = {"tip": np.array([140.0, 0, 20])}
    (solved,) = pose_grips(bend, device, POINTS, solved_centers)
    assert solved.position.tolist() == [140, 0, 20]
    (prescribed,) = pose_grips(twist, device, POINTS, solved_centers)
    assert prescribed.can_shift
    assert prescribed.position.tolist() == [145, 0, 0]  # its center of rotation


def test_a_moved_grip_becomes_one_edit(device):
    bend, twist = device.poses
    turn = np.deg2rad(-40) * np.array([0, 1.0, 0])
    turned = move_grip(bend, device, POINTS, "tip", np.array([1.0, 2, 3]), turn)
    assert np.isnan(turned.handles[0].translation).all()  # its translation stays free
    assert [e.name for e in pose_edits(bend, turned)] == ["turn `tip` in `bend`"]
    handle = twist.handles[0]
    shifted = move_grip(twist, device, POINTS, "tip", np.array([145.0, 0, 7]), handle.rotation)
    assert shifted.handles[0].translation.tolist() == [0, 0, 7]
    assert [e.name for e in pose_edits(twist, shifted)] == ["move `tip` in `twist`"]
    missing = move_grip(twist, device, POINTS, "gone", np.zeros(3), turn)
    assert pose_edits(twist, missing) == []


def test_a_pulled_point_has_a_grip_at_its_goal(device):
    document = tomlkit.parse(TEXT)
    drag_point("bend", np.array([75.0, 0, 15]), np.array([0, 0, 9.0]), 1.0).change(document)
    pulled = parse_device(tomlkit.dumps(document), device.source)
    bend = pulled.poses[0]
    grip = pose_grips(bend, pulled, POINTS, {})[-1]
    assert grip.position.tolist() == [75, 0, 24]
    assert not grip.can_turn
    moved = move_grip(bend, pulled, POINTS, grip.name, np.array([75.0, 4, 24]), np.zeros(3))
    assert moved.drags[0].by.tolist() == [0, 4, 9]
    assert [e.name for e in pose_edits(bend, moved)] == ["move a pull in `bend`"]
