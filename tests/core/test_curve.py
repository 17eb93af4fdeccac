"""Test planes, Hermite curves and sampled paths against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.curve import (
    MIN_PATH_SAMPLES,
    Hermite,
    Plane,
    arc_lengths,
    catmull_rom,
    curvature,
    distinct_planes,
    per_span_for_sag,
    per_span_for_signal,
    per_span_for_spacing,
    resample,
    sample_path,
)
from defsense_fab.core.device.device import Sensor

RADIUS = 20.0


@pytest.fixture
def quarters():
    """Return three quarters of a circle in spans of different lengths."""
    angle = np.radians([0, 20, 60, 150, 270])
    points = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    step = np.gradient(angle)
    tangents = RADIUS * step[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return Hermite(points, tangents)


@pytest.mark.parametrize("spacing", [0.1, 0.25, 1.0])
def test_neighbors_are_within_the_spacing(quarters, spacing):
    points = quarters.sample(per_span_for_spacing(quarters, spacing))
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert step.max() <= 1.05 * spacing
    assert step.max() > 0.5 * spacing or per_span_for_spacing(quarters, spacing) == 32


@pytest.mark.parametrize("sag", [0.004, 0.02])
def test_chords_are_within_the_sag(quarters, sag):
    count = per_span_for_sag(quarters, sag)
    chords, fine = quarters.sample(count), quarters.sample(50 * count)
    a, b = (np.repeat(x, 50, axis=0) for x in (chords[:-1], chords[1:]))
    side = np.stack([a[:, 1] - b[:, 1], b[:, 0] - a[:, 0]], axis=1)
    away = ((fine[:-1] - a) * side).sum(axis=1) / np.linalg.norm(side, axis=1)
    assert 0.5 * sag < np.abs(away).max() <= sag


def test_path_is_in_its_plane_and_has_enough_points(quarters):
    plane = Plane.from_normal(np.array([1.0, 2, 3]), np.array([1.0, 1, 1]), np.array([1.0, 0, 0]))
    path = sample_path(Sensor("c", plane, quarters, frozenset()))
    assert len(path) == 4 * per_span_for_signal(quarters) + 1 > MIN_PATH_SAMPLES
    assert (path - plane.origin) @ plane.normal == pytest.approx(np.zeros(len(path)), abs=1e-12)
    assert len(sample_path(Sensor("c", plane, quarters, frozenset()), 7)) == 29


def test_lengths_and_resampled_points_of_a_polyline():
    line = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0]])
    assert arc_lengths(line).tolist() == [0, 3, 7]
    assert arc_lengths(np.stack([line, 2 * line])).tolist() == [[0, 3, 7], [0, 6, 14]]
    assert resample(line, 1.0, 5.0, 5) == pytest.approx(
        np.array([[1.0, 0, 0], [2, 0, 0], [3, 0, 0], [3, 1, 0], [3, 2, 0]])
    )
    assert resample(line[:, :2], 0.0, 7.0, 3) == pytest.approx(
        np.array([[0.0, 0], [3, 0.5], [3, 4]])
    )


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


def test_frame_from_its_own_axes_is_equal_to_the_last_digit():
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
    assert distinct_planes([a, b, c]) == [a, c]
