"""Hermite curves and planes against closed forms."""

import numpy as np
import pytest

from defsense_fab.core.curves.curve import Hermite, Plane, catmull_rom, curvature, distinct


def test_straight_points_give_a_straight_curve():
    points = np.array([[0, 0], [1, 0], [5, 0], [20, 0.0]])
    curve = Hermite(points, catmull_rom(points))
    assert np.abs(curve.sample(20)[:, 1]).max() == 0
    assert (np.diff(curve.sample(20)[:, 0]) > 0).all()
    assert np.abs(curvature(curve.points, curve.tangents, 8)).max() == 0


def test_curvature_of_a_fine_circle():
    a = np.linspace(0, np.pi, 41)
    points = 10 * np.stack([np.cos(a), np.sin(a)], axis=1)
    tangents = 10 * (a[1] - a[0]) * np.stack([-np.sin(a), np.cos(a)], axis=1)
    assert curvature(points, tangents, 8) == pytest.approx(0.1, rel=1e-3)


def test_plane_frames_are_right_handed():
    plane = Plane.from_normal(np.ones(3), np.array([1.0, 2, 3]), np.array([1.0, 0, 0]))
    assert np.linalg.det(plane.axes) == pytest.approx(1)
    assert (plane.to_world(np.array([[3.0, 4.0]])) - 1) @ plane.normal == pytest.approx(0)


def test_a_frame_made_from_its_own_axes_is_itself_to_the_last_digit():
    rng = np.random.default_rng(0)
    for _ in range(2000):
        normal, x_axis = rng.normal(size=(2, 3)) * 10 ** rng.uniform(-3, 3, (2, 1))
        plane = Plane.from_normal(rng.normal(size=3), normal, x_axis)
        again = Plane.from_normal(plane.origin, plane.normal, plane.axes[:, 0])
        assert (again.axes == plane.axes).all()
        assert abs(plane.axes.T @ plane.axes - np.eye(3)).max() < 1e-15


def test_coincident_planes_count_once():
    a = Plane.from_normal(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    b = Plane.from_normal(np.array([5, 3, 0.0]), np.array([0, 0, -1.0]), np.array([0, 1.0, 0]))
    c = Plane.from_normal(np.array([0, 0, 1.0]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    assert distinct([a, b, c]) == [a, c]
