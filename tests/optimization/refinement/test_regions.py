"""Regions in which cords and traces leave the body, and regions that are kept whole."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.regions import (
    Box,
    Cylinder,
    HalfSpace,
    Sphere,
    hull_points,
    inset,
)
from defsense_fab.geometry.kernels import surface_queries
from defsense_fab.optimization.limits.constraints import Constraints
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.problem.cord_parameters import CordParameters
from tests.optimization.conftest import LIMITS, check_jacobian, search

SHAPES = [
    Box(np.array([-1.0, -2, -3]), np.array([4.0, 5, 6])),
    Sphere(np.array([1.0, 2, 3]), 4.0),
    HalfSpace(np.array([1.0, 0, 0]), np.array([3.0, 1, -2])),
    Cylinder(np.array([0.0, 0, -3]), np.array([1.0, 2, 5]), 3.0),
]
BASE = Box(np.array([-1.0, -16, -16]), np.array([10.0, 16, 16]))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_the_inset_of_a_region(shape):
    """Its sign is that of being inside, and its gradient that of finite differences."""
    points = np.random.default_rng(0).uniform(-8, 8, (400, 3))
    distance, gradient = inset(shape, points)
    assert ((distance > 0) == shape.contains(points)).all()
    assert np.linalg.norm(gradient, axis=1) == pytest.approx(np.ones(400))
    for axis in range(3):
        step = 1e-6 * np.eye(3)[axis]
        slope = (inset(shape, points + step)[0] - inset(shape, points - step)[0]) / 2e-6
        assert np.mean(np.abs(slope - gradient[:, axis]) < 1e-4) > 0.99  # but at edges


@pytest.mark.slow
def test_derivatives_of_exits_by_finite_differences(problem, straight):
    limits = replace(LIMITS, exits=(BASE, Sphere(np.array([150.0, 3, 4]), 12.0)))
    planar, spatial = straight("a", y=5), straight("b", y=-5).in_space()
    cords = [CordParameters(planar), CordParameters(spatial)]
    constraints = Constraints(problem.surface, problem.depth, limits, cords)
    x = np.random.default_rng(5).normal(0, 0.8, sum(c.size for c in cords))
    values, jacobian = constraints(x)
    without = Constraints(problem.surface, problem.depth, LIMITS, cords)(x)[0]
    assert len(values) == len(without) + 4
    check_jacobian(constraints, x, jacobian)


@pytest.mark.slow
@pytest.mark.parametrize("in_space", [False, True])
def test_a_search_keeps_the_exits(problem, in_space):
    """Rays from the ends of the found path meet the skin in the region."""
    limits = replace(LIMITS, exits=(BASE,), is_cut=not in_space)
    problem = replace(problem, limits=limits)
    found = search(problem, extra=1, starts=2, candidates=2000, in_space=in_space)
    (sensor,) = found.sensors
    points = sensor.plane.to_world(sensor.curve.sample(200))
    for end, before in ((points[0], points[1]), (points[-1], points[-2])):
        out = (end - before) / np.linalg.norm(end - before)
        hit = surface_queries.cast_ray(end, out, problem.surface)[0]
        assert inset(BASE, (end + hit * out)[None])[0][0] > -0.25


@pytest.mark.slow
def test_an_exit_elsewhere_is_found(problem, straight):
    limits = replace(LIMITS, exits=(BASE,))
    (violation,) = verify([straight("a", y=5)], problem.surface, limits).violations
    assert (violation.code, violation.cords) == ("exit-not-allowed", ("a",))


BOLT = Cylinder(np.array([75.0, 6, -16]), np.array([75.0, 6, 16]), 3.0)


@pytest.mark.parametrize("shape", [s for s in SHAPES if not isinstance(s, HalfSpace)])
def test_the_hull_points_of_a_region(shape):
    """No point of the region is beyond its hull points in any direction."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-8, 8, (4000, 3))
    inside, hull = points[shape.contains(points)], hull_points(shape)
    for direction in rng.normal(size=(50, 3)):
        assert (inside @ direction).max() <= (hull @ direction).max() + 1e-9


@pytest.mark.slow
def test_derivatives_at_kept_regions_by_finite_differences(problem, straight):
    limits = replace(LIMITS, kept_whole=(BOLT, Sphere(np.array([30.0, -9, 8]), 4.0)))
    cords = [CordParameters(straight("a", y=-5)), CordParameters(straight("b", z=7).in_space())]
    constraints = Constraints(problem.surface, problem.depth, limits, cords)
    x = np.random.default_rng(5).normal(0, 0.5, sum(c.size for c in cords))
    values, jacobian = constraints(x)
    assert len(values) > len(Constraints(problem.surface, problem.depth, LIMITS, cords)(x)[0])
    check_jacobian(constraints, x, jacobian)


@pytest.mark.slow
@pytest.mark.parametrize("in_space", [False, True])
def test_a_search_spares_kept_regions(problem, in_space):
    limits = replace(LIMITS, kept_whole=(BOLT,), is_cut=not in_space)
    problem = replace(problem, limits=limits)
    found = search(problem, extra=2, starts=2, candidates=3000, in_space=in_space)
    axis = np.array([75.0, 6.0])
    for sensor in found.sensors:
        points = sensor.plane.to_world(sensor.curve.sample(300))
        distance = np.linalg.norm(points[:, :2] - axis, axis=1).min()
        assert distance >= BOLT.radius + LIMITS.depth - 1e-3
        if not in_space:
            ends = np.array([[75.0, 6, -16], [75.0, 6, 16]]) - sensor.plane.origin
            heights = ends @ sensor.plane.normal
            assert heights[0] * heights[1] > 0


@pytest.mark.slow
def test_a_drawing_through_a_kept_region_is_found(problem, straight):
    limits = replace(LIMITS, kept_whole=(BOLT,))
    codes = {v.code for v in verify([straight("a", y=6)], problem.surface, limits).violations}
    assert codes == {"kept-region-crossed", "kept-region-cut"}


@pytest.mark.slow
def test_derivatives_at_pads_by_finite_differences(problem, straight):
    """The mouths of the first path are near the region, which its pads keep away from."""
    button = Sphere(np.array([4.0, 10, 6]), 3.0)
    limits = replace(LIMITS, kept_whole=(button,), pad=(4.0, 1.2), is_cut=False)
    cords = [CordParameters(straight(n, y=y).in_space()) for n, y in (("a", 5), ("b", -5))]
    constraints = Constraints(problem.surface, problem.depth, limits, cords)
    x = np.random.default_rng(6).normal(0, 0.3, sum(c.size for c in cords))
    values, jacobian = constraints(x)
    plain = replace(limits, kept_whole=())
    without = Constraints(problem.surface, problem.depth, plain, cords)(x)[0]
    assert len(values) > len(without) + 4
    check_jacobian(constraints, x, jacobian)


@pytest.mark.slow
def test_a_pad_near_a_kept_region_is_found(problem, straight):
    """The mouth at x = 0 is 2.5 mm from the region: enough for the channel, not for a pad."""
    button = Cylinder(np.array([-1.0, 5, 5.5]), np.array([10.0, 5, 5.5]), 3.0)
    limits = replace(LIMITS, kept_whole=(button,), is_cut=False)
    sensors = [straight("a", y=5).in_space()]
    assert not verify(sensors, problem.surface, limits).violations
    limits = replace(limits, pad=(4.0, 1.2))
    (violation,) = verify(sensors, problem.surface, limits).violations
    assert violation.code == "kept-region-crossed"
    assert violation.value == pytest.approx(2.5, abs=1e-6)
