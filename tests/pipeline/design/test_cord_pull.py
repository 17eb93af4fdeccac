"""Cords that pull a soft body out of its shape."""

import re
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.pipeline.design.cord_pull import is_stiff, pulls
from defsense_fab.sensing.built_cord import BuiltCord
from tests.conftest import structured_bar
from tests.places import BAR

PATH = np.stack([np.linspace(10, 140, 131), np.zeros(131), np.full(131, 12.0)], axis=1)


@pytest.fixture(scope="module")
def locator():
    bar = structured_bar([0, -15, -15], [150, 15, 15], (20, 4, 4))
    return PointLocator(QuadraticMesh.from_linear(bar))


@pytest.fixture(scope="module")
def device():
    return load_device(BAR)


def test_the_pull_of_a_held_cord_is_told_with_what_it_does(device, locator):
    """As a beam bends under 3 MPa times 8 % on 3.14 mm2, 12 mm off its axis, fixed over 10 mm."""
    (said,) = pulls(device, locator, [BuiltCord(PATH, 0.0, 0.08)], 0.5)
    force, moved = (float(re.search(rf"([0-9.]+) {unit}\b", said)[1]) for unit in ("N", "mm"))
    assert force == pytest.approx(0.75, abs=0.06)
    beam = 0.754 * 12 / (0.6 * 30**4 / 12) * 130 * (150 - 75)
    assert moved == pytest.approx(beam, rel=0.08)
    assert not pulls(device, locator, [BuiltCord(PATH, 0.0, 0.08)], 3.0)


def test_cords_on_both_sides_pull_against_each_other(device, locator):
    both = [BuiltCord(PATH * [1, 1, k], 0.0, 0.08) for k in (1, -1)]
    assert not pulls(device, locator, both, 0.6)


def test_nothing_is_said_of_cords_that_do_not_pull(device, locator):
    cord = BuiltCord(PATH, 0.0, 0.08)
    assert not pulls(device, locator, [replace(cord, prestretch=None)], 0.0)
    assert not pulls(device, locator, [replace(cord, prestretch=0.0)], 0.0)
    firm = replace(device, material=replace(device.material, young_modulus=12.0))
    assert is_stiff(device)
    assert not is_stiff(firm)
    assert not pulls(firm, locator, [cord], 0.0)
    loose = replace(device, poses=tuple(replace(p, fixed=()) for p in device.poses))
    assert not pulls(loose, locator, [cord], 0.0)
