"""Test the signals of printed traces in the search, whose segments conduct by their direction."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import sample_path
from defsense_fab.core.response import ResponseSpec
from defsense_fab.optimization.problem.cord_kinematics import place_cord
from defsense_fab.optimization.problem.cord_parameters import CordParameters
from defsense_fab.optimization.problem.cord_signals import SignalModel
from defsense_fab.optimization.problem.objective import Objective
from defsense_fab.optimization.refinement.refine import layout_error
from defsense_fab.sensing.built_cord import BuiltCord, CordReading, TraceSection
from defsense_fab.sensing.response import build_response

UP = np.array([0.48, 0.64, 0.6])
SECTION = TraceSection(width=1.2, height=0.8, up=UP, between_layers=3.0)
RESPONSES = {
    "line": ResponseSpec("line", {"k": 2.0}, (-0.1, 0.1)),
    "quadratic": ResponseSpec("quadratic", {"k": 2.0, "q": 6.0}, (-0.1, 0.1)),
}


@pytest.fixture(params=RESPONSES)
def traced(problem, request):
    """Return the problem of the twisted bar with printed traces, and how they are read."""
    response = build_response(RESPONSES[request.param])
    reading = CordReading(response, 125.0, 0.003, 50.0, SECTION)
    contact = np.sqrt(2) * reading.contact / (reading.ohm_per_mm * reading.relative)
    sense = SignalModel(response, True, contact=contact, section=SECTION)
    return replace(problem, sense=sense, noise=reading.relative), reading


def two_cords(straight, in_space):
    """Return a cord with a free plane and one without, or both in space."""
    sensors = [straight("a", y=5), straight("b", y=-4, z=3, free=["path"])]
    return [CordParameters(s.in_space() if in_space else s) for s in sensors]


def random_parameters(cords):
    return np.random.default_rng(3).normal(0, 1.5, sum(c.size for c in cords))


def test_search_and_prediction_have_the_same_signals(traced, straight):
    """Signals of the search are divided by their noise."""
    problem, reading = traced
    cords = two_cords(straight, in_space=True)
    objective = Objective(problem, cords)
    x = random_parameters(cords)
    signals, _ = objective.signals(x)
    for k, (cord, part) in enumerate(zip(cords, objective.split(x), strict=True)):
        path = place_cord(cord, part).points
        trace = BuiltCord(path, 0.0, None)
        expected = reading.signals(trace, problem.deform(path)) / reading.noise(trace)
        assert np.ptp(SECTION.relative_resistance(path)) > 0.05
        assert signals[1:, k] / problem.noise == pytest.approx(expected, rel=1e-9)
        assert problem.signals(path) == pytest.approx(signals[:, k], rel=1e-9)


@pytest.mark.parametrize("in_space", [False, True])
def test_objective_gradient_by_finite_differences(traced, straight, in_space):
    problem, _ = traced
    cords = two_cords(straight, in_space)
    objective = Objective(problem, cords)
    x = random_parameters(cords)
    value, gradient = objective(x)
    layout = [place_cord(c, p).sensor() for c, p in zip(cords, objective.split(x), strict=True)]
    assert value == pytest.approx(layout_error(problem, layout) ** 2, rel=1e-6)
    assert objective.model(x).gradient == pytest.approx(gradient, rel=1e-6, abs=1e-9)
    for i in range(len(x)):
        e = 1e-5 * np.eye(len(x))[i]
        slope = (objective(x + e)[0] - objective(x - e)[0]) / 2e-5
        assert gradient[i] == pytest.approx(slope, rel=1e-3, abs=1e-5 * value)


def test_slopes_by_finite_differences(traced, straight):
    """Points move at random, so segments rise in all directions."""
    problem, _ = traced
    rng = np.random.default_rng(0)
    paths = [sample_path(straight("a", y=5)), sample_path(straight("b", y=-4, z=3))[:70]]
    paths = [p + rng.normal(0, 0.5, p.shape) for p in paths]
    points, ends = np.concatenate(paths), np.cumsum([0, *map(len, paths)])
    carried = problem.carrier.carry(points, ends)
    step = rng.normal(0, 1e-5, points.shape)
    before, after = (problem.carrier.carry(points + s * step, ends).signals for s in (-1, 1))
    change, slopes = (after - before) / 2, carried.slopes()
    got = [np.einsum("pas,pa->s", slopes[a:b], step[a:b]) for a, b in itertools.pairwise(ends)]
    assert np.stack(got, axis=1) == pytest.approx(change, rel=2e-3, abs=1e-9)
    weights = rng.normal(size=change.shape)
    assert (carried.pull(weights) * step).sum() == pytest.approx(
        (np.stack(got, axis=1) * weights).sum(), abs=1e-12
    )


def test_level_traces_with_equal_layers_sense_like_cords(problem, straight):
    """The path is level, and conducts alike along it."""
    path = sample_path(straight("a", y=5))
    section = replace(SECTION, up=np.array([0.0, 0.0, 1.0]))
    cords, traces = (
        replace(problem, sense=SignalModel(problem.sense.response, True, section=s))
        for s in (None, section)
    )
    assert traces.signals(path) == pytest.approx(cords.signals(path), abs=1e-12)
