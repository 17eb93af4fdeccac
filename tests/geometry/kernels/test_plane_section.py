"""Outlines of a box cut by planes, whose shape is known."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from defsense_fab.core.curve import Plane
from defsense_fab.geometry.kernels.surface_queries import (
    inside_section,
    nearest_on_section,
    plane_section,
)
from tests.conftest import box_surface

BOX = box_surface((-20, -10, -5), (20, 10, 5))


def area(section, plane):
    """By Green's theorem, with each segment's direction from which side is inside."""
    middle = section.mean(1)
    along = section[:, 1] - section[:, 0]
    out = np.stack([along[:, 1], -along[:, 0]], axis=1)
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)
    inner = inside_section(section, middle - 1e-4 * out)
    out *= np.where(inner, 1, -1)[:, None]
    return 0.5 * (np.einsum("ij,ij->i", middle, out) * np.linalg.norm(along, axis=1)).sum()


def test_a_level_section_is_the_boxes_rectangle():
    plane = Plane.from_normal(np.array([3.0, 2.0, 1.0]), np.array([0, 0, 1.0]), np.eye(3)[0])
    section = plane_section(BOX, plane)
    np.testing.assert_allclose(section.min((0, 1)), [-23, -12], atol=1e-12)
    np.testing.assert_allclose(section.max((0, 1)), [17, 8], atol=1e-12)
    np.testing.assert_allclose(area(section, plane), 800, rtol=1e-9)


@given(st.floats(-1.0, 1.0), st.floats(-3, 3))
def test_a_tilted_section_is_longer_by_the_cosine(tilt, height):
    normal = np.array([0.0, np.sin(tilt), np.cos(tilt)])
    plane = Plane.from_normal(np.array([0.0, 0.0, height]), normal, np.eye(3)[0])
    section = plane_section(BOX, plane)
    if abs(height) + 10 * abs(np.tan(tilt)) < 5:
        np.testing.assert_allclose(area(section, plane), 800 / np.cos(tilt), rtol=1e-6)
    ends = np.round(section.reshape(-1, 2), 6)
    _, counts = np.unique(ends, axis=0, return_counts=True)
    assert (counts % 2 == 0).all()  # closed


def test_through_corners_and_beside_the_box():
    def level(z):
        return Plane.from_normal(np.array([0.0, 0.0, z]), np.array([0, 0, 1.0]), np.eye(3)[0])

    assert len(plane_section(BOX, level(5.0))) == 0
    assert len(plane_section(BOX, level(-5.0))) > 0  # counted as just above
    assert plane_section(BOX, level(6.0)).shape == (0, 2, 2)


def test_the_nearest_point_lies_on_the_outline():
    plane = Plane.from_normal(np.zeros(3), np.array([0, 0, 1.0]), np.eye(3)[0])
    section = plane_section(BOX, plane)
    np.testing.assert_allclose(nearest_on_section(section, np.array([3.0, 8.0])), [3, 10])
    np.testing.assert_allclose(nearest_on_section(section, np.array([30.0, 30.0])), [20, 10])
