"""Planes to draw on, strokes that become cords, and points that snap."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.errors import LayoutError
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.problem.problem import Limits
from defsense_fab.workflow.design.draw_cord import (
    Snapper,
    drawing_planes,
    fit_stroke,
    offset_plane,
    ray_on_plane,
)
from tests.conftest import box_surface
from tests.support.errors import raises

FLAT_BODY = box_surface((0, -15, -10), (150, 15, 10))
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
    outside_plane = Plane.from_normal(
        np.array([0.0, 0, 40]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    )
    with raises(LayoutError, "plane-misses-body"):
        fit_stroke(BODY, outside_plane, wave(0, 150))
    with raises(LayoutError, "stroke-outside-body"):
        fit_stroke(BODY, PLANE, wave(200, 300))
    with raises(LayoutError, "stroke-too-short"):
        fit_stroke(BODY, PLANE, np.array([[10.0, 0], [10.1, 0]]))
    for nothing in (np.array([]), np.full((5, 2), np.nan)):
        with raises(LayoutError, "stroke-too-short"):
            fit_stroke(BODY, PLANE, nothing)


def cord(name, plane, points):
    points = np.array(points, float)
    return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset({"path"}))


def test_planes_across_the_thin_side_come_first_and_lie_along_the_body():
    planes = drawing_planes(FLAT_BODY, ())
    plane = planes["middle, normal to z"]
    assert list(planes) == [f"middle, normal to {axis}" for axis in "zyx"]
    np.testing.assert_allclose(plane.origin, [75, 0, 0])
    np.testing.assert_allclose(plane.axes[:, 0], [1, 0, 0])
    np.testing.assert_allclose(offset_plane(plane, 4.0).origin, [75, 0, 4])
    top = cord("top", offset_plane(plane, 3.0), [[0, 0], [10, 0]])
    assert drawing_planes(FLAT_BODY, (top,))["of top"] is top.plane


def test_a_point_is_where_the_ray_from_the_eye_meets_the_plane():
    plane = Plane.from_normal(np.array([10.0, 0, 5]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    eye = np.array([10.0, 0, 105])
    np.testing.assert_allclose(ray_on_plane(plane, eye, np.array([12.0, 3, 55])), [4, 6])
    assert ray_on_plane(plane, eye, np.array([11.0, 0, 105])) is None  # parallel
    assert ray_on_plane(plane, eye, np.array([10.0, 0, 106])) is None  # points away


def test_a_point_snaps_to_other_cords_the_surface_and_the_middle():
    plane = drawing_planes(FLAT_BODY, ())["middle, normal to z"]
    other = cord("side", plane, [[20.0, 8.0], [40, 8]])
    above = cord("above", offset_plane(plane, 5.0), [[0.0, 3.0], [40, 3]])
    snap = Snapper(FLAT_BODY, plane, (other, above), 1.0).snap
    at_cord = snap(np.array([20.4, 8.3]))
    assert (at_cord.target, at_cord.cord) == ("cord", "side")
    np.testing.assert_allclose(at_cord.point, [20, 8])
    assert snap(np.array([0.2, 3.3])).target == "middle"  # the other cord lies above
    np.testing.assert_allclose(snap(np.array([0.2, 3.3])).point, [0, 3.3])
    np.testing.assert_allclose(snap(np.array([-0.6, 0.7])).point, [0, 0])
    assert snap(np.array([30.0, 14.6])).target == "surface"
    np.testing.assert_allclose(snap(np.array([30.0, 14.6])).point, [30, 15])
    free = snap(np.array([30.0, 5.0]))
    assert free.target is None
    np.testing.assert_array_equal(free.point, [30, 5])
