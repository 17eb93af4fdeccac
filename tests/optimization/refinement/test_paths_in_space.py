"""Check gradients, limits and searches of paths in space on a twisted bar."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import REST_FRAME, Hermite, catmull_rom, curvature, sample_path
from defsense_fab.core.device.device import DECODERS, Sensor
from defsense_fab.optimization.limits.constraints import Constraints
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.problem.cord_kinematics import place_cord
from defsense_fab.optimization.problem.cord_parameters import CordParameters, round_layout
from defsense_fab.optimization.problem.objective import Objective
from defsense_fab.optimization.refinement.refine import layout_error
from defsense_fab.optimization.search.candidate_families import vary_sensor
from defsense_fab.store.layout import CordPath
from tests.optimization.conftest import LIMITS, check_jacobian, search

pytestmark = pytest.mark.slow
FREE = frozenset({"path", "ends"})


def make_helix(name="helix", phase=0.0, free=FREE):
    """Return a path along the bar that turns half around its axis."""
    x = np.linspace(2, 148, 8)
    angle = phase + np.pi * (x - 2) / 146
    points = np.stack([x, 8 * np.cos(angle), 8 * np.sin(angle)], axis=1)
    return Sensor(name, REST_FRAME, Hermite(points, catmull_rom(points)), free)


@pytest.mark.parametrize("decoder", DECODERS)
def test_objective_gradient_by_finite_differences(problem, decoder):
    problem = replace(problem, decoder=decoder)
    cords = [CordParameters(make_helix()), CordParameters(make_helix("b", 2.5, {"path"}))]
    assert [c.size for c in cords] == [48, 30]
    objective = Objective(problem, cords)
    x = np.random.default_rng(3).normal(0, 0.5, sum(c.size for c in cords))
    value, gradient = objective(x)
    layout = [place_cord(c, p).sensor() for c, p in zip(cords, objective.split(x), strict=True)]
    assert value == pytest.approx(layout_error(problem, layout) ** 2, rel=1e-6)
    for i in range(len(x)):
        e = 1e-5 * np.eye(len(x))[i]
        slope = (objective(x + e)[0] - objective(x - e)[0]) / 2e-5
        assert gradient[i] == pytest.approx(slope, rel=1e-3, abs=1e-5 * value)


def test_constraint_derivatives_by_finite_differences(problem, straight):
    """A path in space next to one in a free plane."""
    cords = [CordParameters(make_helix()), CordParameters(straight("b", y=-5))]
    limits = replace(LIMITS, shortest=100.0, longest=170.0)
    constraints = Constraints(problem.surface, problem.depth, limits, cords)
    x = np.random.default_rng(4).normal(0, 0.7, sum(c.size for c in cords))
    _, jacobian = constraints(x)
    check_jacobian(constraints, x, jacobian)


def test_a_lifted_path_is_the_same(problem, straight):
    planar = straight("a", y=5)
    lifted = planar.in_space()
    assert not lifted.curve.is_planar
    assert lifted.free == FREE
    assert sample_path(lifted) == pytest.approx(sample_path(planar), abs=1e-12)
    assert layout_error(problem, [lifted]) == pytest.approx(layout_error(problem, [planar]))
    bend = np.abs(curvature(planar.curve.points, planar.curve.tangents, 6))
    assert curvature(lifted.curve.points, lifted.curve.tangents, 6) == pytest.approx(bend)


def test_a_helix_senses_the_twist_that_a_straight_cord_does_not(problem, straight):
    """The error is within 10 % of that of the best layout in a plane, without a descent."""
    helix, planar = make_helix(), straight("a", y=5)
    assert layout_error(problem, [helix]) < layout_error(problem, [planar]) / 3


def test_a_search_in_space_is_at_least_as_good_and_keeps_the_limits(problem):
    planar = search(problem, extra=1, starts=1, candidates=800)
    spatial = search(problem, extra=1, starts=1, candidates=800, in_space=True)
    assert spatial.rmse <= planar.rmse
    assert not verify(spatial.sensors, problem.surface, LIMITS).violations


def test_a_drawn_path_in_space_keeps_its_ends(problem):
    drawn = make_helix(free=frozenset({"path"}))
    found = search(problem, [drawn], starts=1, candidates=200)
    curve = found.sensors[0].curve
    assert curve.points[[0, 1, -2, -1]] == pytest.approx(
        drawn.curve.points[[0, 1, -2, -1]], abs=1e-4
    )
    assert curve.tangents[[0, -1]] == pytest.approx(drawn.curve.tangents[[0, -1]], abs=1e-4)
    assert found.rmse <= layout_error(problem, [drawn])


def test_variations_of_a_path_in_space(problem):
    batch = vary_sensor(make_helix(), 20, 6.0, np.random.default_rng(0))
    paths = batch.paths(40)
    assert paths[0, [0, -1]] == pytest.approx(make_helix().curve.points[[0, -1]])
    assert np.ptp(paths[:, 20], axis=0).min() > 0.5
    assert np.ptp(paths[:, 0], axis=0).max() < 1e-9


def test_a_rounded_path_is_stored_and_loaded(problem):
    (rounded,) = round_layout((make_helix(),))
    loaded = CordPath.of(rounded).sensor()
    assert loaded.curve.points == pytest.approx(np.round(make_helix().curve.points, 4), abs=1e-12)
    assert sample_path(loaded) == pytest.approx(sample_path(rounded), abs=1e-12)
