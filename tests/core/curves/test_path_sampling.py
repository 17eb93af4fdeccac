"""Points along paths: on a circle, whose lengths are known, and on a polyline with a corner."""

import numpy as np
import pytest

from defsense_fab.core.curves.curve import Hermite, Plane
from defsense_fab.core.curves.path_sampling import (
    SAMPLES,
    arc_lengths,
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
    """Three quarters of a circle in spans of different lengths."""
    angle = np.radians([0, 20, 60, 150, 270])
    points = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    step = np.gradient(angle)
    tangents = RADIUS * step[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return Hermite(points, tangents)


@pytest.mark.parametrize("spacing", [0.1, 0.25, 1.0])
def test_neighbours_are_as_near_as_asked(quarters, spacing):
    points = quarters.sample(per_span_for_spacing(quarters, spacing))
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert step.max() <= 1.05 * spacing
    assert step.max() > 0.5 * spacing or per_span_for_spacing(quarters, spacing) == 32


@pytest.mark.parametrize("sag", [0.004, 0.02])
def test_chords_lie_as_near_to_the_curve_as_asked(quarters, sag):
    count = per_span_for_sag(quarters, sag)
    chords, fine = quarters.sample(count), quarters.sample(50 * count)
    a, b = (np.repeat(x, 50, axis=0) for x in (chords[:-1], chords[1:]))
    side = np.stack([a[:, 1] - b[:, 1], b[:, 0] - a[:, 0]], axis=1)
    away = ((fine[:-1] - a) * side).sum(axis=1) / np.linalg.norm(side, axis=1)
    assert 0.5 * sag < np.abs(away).max() <= sag


def test_a_path_lies_in_its_plane_with_enough_points(quarters):
    plane = Plane.from_normal(np.array([1.0, 2, 3]), np.array([1.0, 1, 1]), np.array([1.0, 0, 0]))
    path = sample_path(Sensor("c", plane, quarters, frozenset()))
    assert len(path) == 4 * per_span_for_signal(quarters) + 1 > SAMPLES
    assert (path - plane.origin) @ plane.normal == pytest.approx(np.zeros(len(path)), abs=1e-12)
    assert len(sample_path(Sensor("c", plane, quarters, frozenset()), 7)) == 29


def test_lengths_and_even_points_of_a_polyline():
    line = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0]])
    assert arc_lengths(line).tolist() == [0, 3, 7]
    assert arc_lengths(np.stack([line, 2 * line])).tolist() == [[0, 3, 7], [0, 6, 14]]
    assert resample(line, 1.0, 5.0, 5) == pytest.approx(
        np.array([[1.0, 0, 0], [2, 0, 0], [3, 0, 0], [3, 1, 0], [3, 2, 0]])
    )
    assert resample(line[:, :2], 0.0, 7.0, 3) == pytest.approx(
        np.array([[0.0, 0], [3, 0.5], [3, 4]])
    )
