"""Edits of the regions and points that a pose holds and moves."""

from __future__ import annotations

import numpy as np
import pytest
import tomlkit

from defsense_fab.core.device.device_file import parse_device
from defsense_fab.core.errors import DeviceError
from defsense_fab.studio.edits.poses import (
    drag_point,
    move_drag,
    remove_drag,
    role_of,
    round_rotation,
    set_role,
    shift_region,
    stiffen_drag,
)
from tests.studio.devices import TEXT, write_device
from tests.support.errors import raises

AT, OTHER = np.array([75.0, 0, 15]), np.array([80.0, 0, 15])


def changed(*edits, text=TEXT):
    document = tomlkit.parse(text)
    for edit in edits:
        edit.change(document)
    return tomlkit.dumps(document)


def test_a_region_is_free_held_turned_or_moved(tmp_path):
    folder = write_device(tmp_path)
    bend, twist = parse_device(TEXT, folder).poses
    assert [role_of(bend, n) for n in ("base", "tip", "other")] == ["held", "turned", "free"]
    assert role_of(twist, "tip") == "moved"
    turned = changed(set_role("bend", "base", "turned"), set_role("bend", "tip", "held"))
    pose = parse_device(turned, folder).poses[0]
    assert [role_of(pose, n) for n in ("base", "tip")] == ["turned", "held"]
    assert np.rad2deg(pose.handles[0].rotation) == pytest.approx([0, 0, 10])
    moved = set_role("bend", "tip", "moved", [1.0, 0, 2])
    (handle,) = parse_device(changed(moved), folder).poses[0].handles
    assert handle.translation.tolist() == [1, 0, 2]
    assert np.rad2deg(handle.rotation) == pytest.approx([0, -30, 0])  # as before
    assert changed(moved, set_role("bend", "tip", "turned")) == TEXT
    assert changed(set_role("bend", "base", "held"), set_role("bend", "tip", "turned")) == TEXT
    with raises(DeviceError, "pose-without-motion"):
        parse_device(changed(set_role("bend", "tip", "free")), folder)


def test_pulls_are_moved_and_deleted(tmp_path):
    folder = write_device(tmp_path)
    two = [drag_point("twist", p, np.array([0, 0, 5.0]), 1.0) for p in (AT, OTHER)]
    text = changed(
        *two, move_drag("twist", AT, np.array([1.0, 2, 3])), stiffen_drag("twist", AT, 0.5)
    )
    first, second = parse_device(text, folder).poses[1].drags
    assert first.by.tolist() == [1, 2, 3]
    assert first.stiffness == 0.5
    assert second.by.tolist() == [0, 0, 5]
    fewer = parse_device(changed(remove_drag("twist", AT), text=text), folder).poses[1].drags
    assert [d.at.tolist() for d in fewer] == [OTHER.tolist()]
    with raises(DeviceError, "point-not-pulled", pose="twist"):
        changed(move_drag("twist", AT, AT))


def test_regions_of_every_shape_are_moved(tmp_path):
    shapes = """
ball = { sphere = { center = [75, 0, 15], radius = 4 } }
half = { half_space = { origin = [140, 0, 0], normal = [1, 0, 0] } }
rod = { cylinder = { start = [0, 0, 0], end = [150, 0, 0], radius = 3 } }
"""
    text = TEXT.replace("\n[[poses]]", f"{shapes}\n[[poses]]", 1)
    by = np.array([1.5, 0, -2])
    names = ("tip", "ball", "half", "rod")
    moved = parse_device(
        changed(*(shift_region(n, by) for n in names), text=text), write_device(tmp_path)
    )
    regions = moved.regions
    assert regions["tip"].low.tolist() == [141.5, -16, -18]
    assert regions["tip"].high.tolist() == [152.5, 16, 14]
    assert regions["ball"].center.tolist() == [76.5, 0, 13]
    assert regions["half"].origin.tolist() == [141.5, 0, -2]
    assert regions["rod"].start.tolist() == [1.5, 0, -2]
    assert regions["rod"].end.tolist() == [151.5, 0, -2]
    assert "# what the hand moves" in changed(shift_region("tip", by))
    with raises(DeviceError, "not-in-device", table="region", name="gone"):
        changed(shift_region("gone", by))


def test_rotations_are_rounded_as_a_person_writes_them():
    axis, degrees = round_rotation(np.deg2rad(-31.234) * np.array([0.001, 0.9999995, 0.0]))
    assert axis.tolist() == [0, 1, 0]
    assert degrees == pytest.approx(-31.2)
    axis, degrees = round_rotation(np.deg2rad(20) * np.array([0.6, 0.8, 0]))
    assert axis == pytest.approx([0.6, 0.8, 0])
    assert degrees == 20
    assert round_rotation(np.zeros(3))[1] == 0
