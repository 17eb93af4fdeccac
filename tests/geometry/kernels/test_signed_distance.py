"""Depth below the skin of a box, whose distances are known."""

import numpy as np

from defsense_fab.geometry.kernels.surface_queries import SignedDistance
from tests.conftest import box_surface


def test_depth_is_positive_inside_and_negative_outside():
    depth = SignedDistance(box_surface((-20, -10, -5), (20, 10, 5)))
    points = np.array([[0.0, 0, 0], [18, 0, 0], [0, -9.5, 0], [23, 0, 0], [23, 14, 0]])
    np.testing.assert_allclose(depth(points), [5, 2, 0.5, -3, -5], atol=1e-12)
    rng = np.random.default_rng(0)
    q = rng.uniform(-30, 30, (500, 3))
    over = np.abs(q) - [20, 10, 5]
    outside = np.linalg.norm(np.maximum(over, 0), axis=1)
    np.testing.assert_allclose(depth(q), np.where((over < 0).all(1), -over.max(1), -outside))


def test_along_a_path_the_sides_are_those_of_its_points():
    depth = SignedDistance(box_surface((-20, -10, -5), (20, 10, 5)))
    t = np.linspace(0, 1, 300)[:, None]
    for seed in range(5):
        a, b, c = np.random.default_rng(seed).uniform(-30, 30, (3, 3))
        whole = (1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c
        for path in (whole, whole[::60], whole[:1], whole[:0]):
            np.testing.assert_array_equal(depth(path) > 0, depth.inside(path))


def test_the_gradient_is_that_of_the_distance():
    depth = SignedDistance(box_surface((-20, -10, -5), (20, 10, 5)))
    points = np.array([[0.0, 0, 4], [18, 1, 0], [23, 0, 0], [23, 14, 0], [3, 2, 5]])
    found, gradient = depth.with_gradient(points)
    np.testing.assert_array_equal(found, depth(points))
    step = 1e-6
    moved = [depth(points + step * e) - depth(points - step * e) for e in np.eye(3)]
    np.testing.assert_allclose(gradient, np.stack(moved, axis=1) / (2 * step), atol=1e-6)
    on_the_skin = np.array([[20.0, 1, 0], [2, -10, 1]])
    np.testing.assert_allclose(depth.with_gradient(on_the_skin)[1], [[-1, 0, 0], [0, 1, 0]])


def test_what_is_no_point_tells_nothing_of_its_neighbours():
    depth = SignedDistance(box_surface((-20, -10, -5), (20, 10, 5)))
    found = depth(np.array([[0.0, 0, 0], [np.nan] * 3, [1, 0, 0], [30, 0, 0]]))
    np.testing.assert_allclose(found[[0, 2, 3]], [5, 5, -10])
