"""Regions that hold nothing of a body are detected from its surface."""

import numpy as np
import pytest

from defsense_fab.core.device.regions import Box, Cylinder, HalfSpace, Sphere
from defsense_fab.geometry.bodies.regions import describe_extent, describe_region, holds_body

V = np.array


@pytest.mark.parametrize(
    ("shape", "is_held"),
    [
        (Box(V([140.0, -9, -9]), V([160.0, 9, 9])), True),
        (Box(V([240.0, -9, -9]), V([251.0, 9, 9])), False),
        (HalfSpace(V([145.0, 0, 0]), V([1.0, 0, 0])), True),
        (HalfSpace(V([155.0, 0, 0]), V([1.0, 0, 0])), False),
        (Sphere(V([75.0, 0, 0]), 0.5), True),  # inside, far from every corner
        (Sphere(V([75.0, 60, 0]), 3.0), False),
        (Cylinder(V([30.0, -90, 0]), V([30.0, 90, 0]), 0.5), True),
        (Cylinder(V([30.0, 90, 0]), V([30.0, 190, 0]), 0.5), False),
    ],
)
def test_holds_body(bar, shape, is_held):
    assert holds_body(shape, bar) == is_held


def test_places_are_described(bar):
    assert "(0, -15, -15)" in describe_extent(bar)
    text = describe_region(HalfSpace(V([0, 0, 12.0]), V([0, 0, -1.0])))
    assert "(0, 0, 12)" in text
    assert "(0, 0, -1)" in text
