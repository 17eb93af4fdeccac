"""Cords that pull a soft body out of its shape."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.optimization.prediction.assembly_effects import (
    MIN_JOINT_OPENING_MM,
    check_cord_pull,
    find_overstretched_cords,
    min_length_across_joint,
)
from defsense_fab.sensing.built_cord import BuiltCord
from defsense_fab.workflow.build.stage_fabricate import cord_warnings

from ...conftest import structured_bar
from ...support.places import BAR

# Cords that a joint stretches while it is open.


def overstretched(length, wires, joints=2, pocket=7.0):
    """Of a cord of so many mm between its ferrules, in so many joints."""
    ends = [SimpleNamespace(wire=w, pocket=pocket) for w in wires]
    cuts = [SimpleNamespace(cords=(0,), wires=()) for _ in range(joints)]
    made = SimpleNamespace(channels=[SimpleNamespace(name="a", ends=ends)], cuts=cuts)
    path = np.array([[0.0, 0, 0], [length, 0, 0]])
    return find_overstretched_cords(load_device(BAR), made, [BuiltCord(path, 0.0, 0.05)])


def test_a_long_cord_survives_an_open_joint():
    device = load_device(BAR)
    most = device.cord.max_strain
    just = 1.05 * MIN_JOINT_OPENING_MM / (most - 0.05)
    assert overstretched(1.01 * just, ("bend", "bend")) == []
    (note,) = overstretched(0.99 * just, ("bend", "bend"))
    assert (note.code, note.where) == ("cord-short-in-open-joint", "a")
    assert note.data["strain"] > most
    assert overstretched(0.99 * just, ("bend", "bend"), joints=1) == []
    assert (
        min_length_across_joint(device) > just
    )  # which does not know how far it will be stretched


def test_a_cord_crimped_late_needs_length():
    device = load_device(BAR)
    reach = device.cord.ferrule_length / 2 + 5.0
    just = 1.05 * (7.0 - device.cord.ferrule_length / 2 + reach) / (device.cord.max_strain - 0.05)
    assert overstretched(1.01 * just, ("bend", "mouth")) == []
    (note,) = overstretched(0.99 * just, ("bend", "mouth"))
    assert note.code == "cord-short-for-crimping"
    assert note.data["strain"] > device.cord.max_strain
    assert overstretched(10.0, ("bend", "bend"), joints=0) == []


PATH = np.stack([np.linspace(10, 140, 131), np.zeros(131), np.full(131, 12.0)], axis=1)


def task(counts):
    """A bar with markers on its far end alone."""
    locator = PointLocator(
        QuadraticMesh.from_linear(structured_bar([0, -15, -15], [150, 15, 15], counts))
    )
    points = np.array([[150.0, y, z] for y in (-10, 10) for z in (-10, 10)])
    problem = SimpleNamespace(locator=locator, marker_weights=np.full(4, 0.25))
    return SimpleNamespace(everything=problem, points=points)


@pytest.fixture(scope="module")
def coarse():
    return task((20, 4, 4))


@pytest.fixture(scope="module")
def device():
    """The bar of a rubber of 0.6 MPa, which cords pull out of its shape."""
    loaded = load_device(BAR)
    return replace(loaded, material=replace(loaded.material, name="soft", young_modulus=0.6))


def measured(note):
    """Return tension (N) and displacement (mm) of a note."""
    assert note.code == "cords-deform-body"
    return note.data["tension"], note.data["displacement"]


def test_the_pull_of_a_held_cord_deforms_the_body_like_a_beam(device, coarse):
    """As a beam bends under 3 MPa times 8 % on 3.14 mm2, 12 mm off its axis, fixed over 10 mm."""
    (note,) = check_cord_pull(device, coarse, [BuiltCord(PATH, 0.0, 0.08)], 0.5)
    force, moved = measured(note)
    assert force == pytest.approx(0.754, abs=0.01)
    beam = 0.754 * 12 / (0.6 * 30**4 / 12) * 130 * (150 - 75)
    assert moved == pytest.approx(beam, rel=0.08)
    assert not check_cord_pull(device, coarse, [BuiltCord(PATH, 0.0, 0.08)], 3.0)


def test_the_displacement_does_not_depend_on_the_mesh(device, coarse):
    middle = [BuiltCord(PATH * [1, 1, 0], 0.0, 0.08)]
    (one,), (other,) = (check_cord_pull(device, t, middle, 0.0) for t in (coarse, task((30, 6, 6))))
    assert measured(one)[1] == pytest.approx(measured(other)[1], rel=0.06)
    assert measured(one)[1] == pytest.approx(0.754 * 130 / (0.6 * 900), rel=0.1)


def test_cords_on_both_sides_balance(device, coarse):
    both = [BuiltCord(PATH * [1, 1, k], 0.0, 0.08) for k in (1, -1)]
    assert not check_cord_pull(device, coarse, both, 0.5)


def test_cords_that_do_not_pull_give_no_note(device, coarse):
    cord = BuiltCord(PATH, 0.0, 0.08)
    assert not check_cord_pull(device, coarse, [replace(cord, prestretch=None)], 0.0)
    assert not check_cord_pull(device, coarse, [replace(cord, prestretch=0.0)], 0.0)
    firm = replace(device, material=replace(device.material, young_modulus=12.0))
    assert not check_cord_pull(firm, coarse, [cord], 0.2)
    loose = replace(device, poses=tuple(replace(p, fixed=()) for p in device.poses))
    assert not check_cord_pull(loose, coarse, [cord], 0.0)


def test_stiff_bonded_cords_give_a_warning(device):
    bonded = replace(device, fabrication=replace(device.fabrication, assembly="bonded"))
    firm = replace(bonded, material=replace(bonded.material, young_modulus=12.0))
    layout = SimpleNamespace(sensors=(), middles={})
    (warning,) = cord_warnings(bonded, layout)
    assert "3 MPa" in warning
    assert "than soft (" in warning
    assert cord_warnings(firm, layout) == cord_warnings(device, layout) == {}
