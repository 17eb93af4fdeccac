"""Cords drawn by hand on a plane through a box."""

import numpy as np
import pytest

from defsense_fab.core.curve import Plane
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.errors import LayoutError
from defsense_fab.optimize.limits.verification import verify
from defsense_fab.optimize.prediction.draw_cord import fit_stroke
from defsense_fab.optimize.problem.problem import Limits
from tests.conftest import box_surface
from tests.support.errors import raises

BODY = box_surface((0, -15, -15), (150, 15, 15))
PLANE = Plane.from_normal(np.array([0.0, 0.0, 3.0]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))


def wave(first, last):
    x = np.linspace(first, last, 90)
    return np.stack([x, 5 * np.sin(x / 25)], axis=1)


def test_a_stroke_that_crosses_the_body_ends_just_below_the_skin():
    curve = fit_stroke(BODY, PLANE, wave(-30, 180))
    ends = curve.points[[0, -1], 0]
    np.testing.assert_allclose(ends, [1, 149], atol=0.3)
    line = curve.sample(100)
    np.testing.assert_allclose(line[:, 1], 5 * np.sin(line[:, 0] / 25), atol=0.7)


def test_only_ends_near_the_skin_are_extended():
    curve = fit_stroke(BODY, PLANE, wave(12, 100))
    assert curve.points[0, 0] == pytest.approx(1.0, abs=0.3)
    np.testing.assert_allclose(curve.points[-1], [100, 5 * np.sin(4)], atol=0.5)


def test_a_drawn_cord_keeps_the_limits_that_the_build_checks():
    cord = Sensor("drawn", PLANE, fit_stroke(BODY, PLANE, wave(-30, 180)))
    limits = Limits(1.2, 5.0, 3.4, 2.2)
    assert verify([cord], BODY, limits).violations == ()


def test_the_longest_part_within_a_body_is_taken():
    stroke = np.array([[10.0, 10], [20, 10], [25, 30], [35, 30], [40, 8], [120, 8]])
    curve = fit_stroke(BODY, PLANE, stroke)
    assert curve.points[0, 0] > 35


def test_invalid_strokes_are_refused():
    beside = Plane.from_normal(np.array([0.0, 0, 40]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    with raises(LayoutError, "plane-misses-body"):
        fit_stroke(BODY, beside, wave(0, 150))
    with raises(LayoutError, "stroke-outside-body"):
        fit_stroke(BODY, PLANE, wave(200, 300))
    with raises(LayoutError, "stroke-too-short"):
        fit_stroke(BODY, PLANE, np.array([[10.0, 0], [10.1, 0]]))
    for nothing in (np.array([]), np.full((5, 2), np.nan)):
        with raises(LayoutError, "stroke-too-short"):
            fit_stroke(BODY, PLANE, nothing)
