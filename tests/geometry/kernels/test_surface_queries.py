"""Signed distances, rays and plane sections of surfaces whose answers are known."""

import numpy as np
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from defsense_fab.core.curve import Plane
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.kernels.surface_queries import (
    SignedDistance,
    cast_ray,
    inside_section,
    nearest_on_section,
    plane_section,
)
from tests.conftest import box_surface

BOX = box_surface((-20, -10, -5), (20, 10, 5))


def test_depth_is_positive_inside_and_negative_outside():
    depth = SignedDistance(BOX)
    points = np.array([[0.0, 0, 0], [18, 0, 0], [0, -9.5, 0], [23, 0, 0], [23, 14, 0]])
    np.testing.assert_allclose(depth(points), [5, 2, 0.5, -3, -5], atol=1e-12)
    rng = np.random.default_rng(0)
    q = rng.uniform(-30, 30, (500, 3))
    over = np.abs(q) - [20, 10, 5]
    outside = np.linalg.norm(np.maximum(over, 0), axis=1)
    np.testing.assert_allclose(depth(q), np.where((over < 0).all(1), -over.max(1), -outside))


def test_sides_along_a_path_equal_those_of_its_points():
    depth = SignedDistance(BOX)
    t = np.linspace(0, 1, 300)[:, None]
    for seed in range(5):
        a, b, c = np.random.default_rng(seed).uniform(-30, 30, (3, 3))
        whole = (1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c
        for path in (whole, whole[::60], whole[:1], whole[:0]):
            np.testing.assert_array_equal(depth(path) > 0, depth.inside(path))


def test_the_gradient_is_that_of_the_distance():
    depth = SignedDistance(BOX)
    points = np.array([[0.0, 0, 4], [18, 1, 0], [23, 0, 0], [23, 14, 0], [3, 2, 5]])
    result, gradient = depth.with_gradient(points)
    np.testing.assert_array_equal(result, depth(points))
    step = 1e-6
    moved = [depth(points + step * e) - depth(points - step * e) for e in np.eye(3)]
    np.testing.assert_allclose(gradient, np.stack(moved, axis=1) / (2 * step), atol=1e-6)
    on_the_skin = np.array([[20.0, 1, 0], [2, -10, 1]])
    np.testing.assert_allclose(depth.with_gradient(on_the_skin)[1], [[-1, 0, 0], [0, 1, 0]])


def test_nan_points_do_not_affect_their_neighbors():
    depth = SignedDistance(BOX)
    result = depth(np.array([[0.0, 0, 0], [np.nan] * 3, [1, 0, 0], [30, 0, 0]]))
    np.testing.assert_allclose(result[[0, 2, 3]], [5, 5, -10])


def test_no_triangle_on_a_ray_is_missed():
    """Two of a convex body for each line through it, where its supporting planes say."""
    ball = trimesh.creation.icosphere(4, 20.0)
    offset = np.array([700.0, -300.0, 90.0])
    surface = Surface(np.array(ball.vertices) + offset, np.array(ball.faces, np.int64))
    normals, offsets = np.array(ball.face_normals), np.einsum(
        "ij,ij->i", ball.face_normals, ball.triangles[:, 0]
    )  # fmt: skip
    rng = np.random.default_rng(1)
    for _ in range(40):
        start, d = rng.uniform(-9, 9, 3), rng.normal(size=3)
        d /= np.linalg.norm(d)
        rate, room = normals @ d, offsets - normals @ start
        leaves = (room[rate > 1e-9] / rate[rate > 1e-9]).min()
        result = cast_ray(start + offset, d, surface)
        assert len(result) == 1
        np.testing.assert_allclose(result[0], leaves, atol=1e-9)


def test_surfaces_are_not_confused():
    for half in (1.0, 2.0, 3.0):
        box = box_surface([-half] * 3, [half] * 3)
        result = cast_ray(np.array([0.1, 0.05, 0.0]), np.array([1.0, 0, 0]), box)
        np.testing.assert_allclose(result, [half - 0.1])


def area(section, plane):
    """By Green's theorem, with each segment's direction from which side is inside."""
    middle = section.mean(1)
    along = section[:, 1] - section[:, 0]
    out = np.stack([along[:, 1], -along[:, 0]], axis=1)
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)
    inner = inside_section(section, middle - 1e-4 * out)
    out *= np.where(inner, 1, -1)[:, None]
    return 0.5 * (np.einsum("ij,ij->i", middle, out) * np.linalg.norm(along, axis=1)).sum()


def test_level_section_is_the_rectangle_of_the_box():
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


def test_sections_through_corners_and_outside_the_box():
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
