"""Moving a region in a pose becomes an edit of the pose."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.device.device_file import parse_device
from defsense_fab.studio.edits.poses import pose_edits
from defsense_fab.studio.steps.poses.grips import move_grip
from tests.studio.devices import TEXT, write_device

POINTS = np.array(
    [[x, y, z] for x in (0.0, 5, 75, 142, 150) for y in (-15.0, 15) for z in (-15.0, 15)]
)


@pytest.fixture
def device(tmp_path):
    return parse_device(TEXT, write_device(tmp_path))


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
