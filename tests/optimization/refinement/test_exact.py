"""Reproduce the method's numbers on exact fields: cords on twist, on ramps and on mixtures."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import sample_path
from defsense_fab.core.response import ResponseSpec
from defsense_fab.decoding.ridge import fit_ridge
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.problem.cord_signals import SignalModel
from defsense_fab.optimization.refinement.refine import optimize_layout
from defsense_fab.optimization.search.starting_layouts import LayoutSearch
from defsense_fab.sensing.response import build_response
from tests.conftest import structured_bar
from tests.optimization import exact


@pytest.fixture(scope="module")
def make(bar):
    mesh = structured_bar([0, -15, -15], [150, 15, 15], [30, 6, 6])
    return lambda states, **more: exact.problem(bar, mesh, states, **more)


def design(problem, cords, seed=0, starts=6):
    """Return the optimized layout of so many cords."""
    rng = np.random.default_rng(seed)
    found = optimize_layout(problem, [], rng, lambda f, m: None, LayoutSearch(cords, starts=starts))
    assert not verify(found.sensors, problem.surface, problem.limits).violations
    return found.sensors


def error(problem, sensors, on=None):
    """Return the RMSE (mm) without noise of the decoder for `problem` on the states of `on`."""
    on = on or problem
    trained, tested = (
        np.stack([p.signals(sample_path(s)) for s in sensors], axis=1) for p in (problem, on)
    )
    flat = [
        p.markers.reshape(len(p.markers), -1) / np.sqrt(p.markers.shape[1]) for p in (problem, on)
    ]
    decoder = fit_ridge(problem.features(len(sensors)), trained, flat[0], problem.noise)
    square = ((decoder(tested) - flat[1]) ** 2).sum(1)
    return float(np.sqrt(square[0 if on is problem else 1 :].mean()))


def test_floors_match_the_analytic_prototypes(make):
    """The analytic prototypes have floors of 1.174, 0.236 and 0.950 mm."""
    assert make(exact.TWISTS).floor(1) == pytest.approx(1.174, abs=1e-3)
    assert make(exact.RAMPS).floor(3) == pytest.approx(0.236, abs=1e-3)
    assert make(exact.MIXTURES).floor(3) == pytest.approx(0.950, abs=1e-3)


def test_one_cord_on_twist_reaches_the_floor(make):
    problem = make(exact.TWISTS)
    assert error(problem, design(problem, 1)) < 1.02 * problem.floor(1)


@pytest.mark.slow
def test_three_cords_on_ramps(make):
    problem = make(exact.RAMPS)
    found = [error(problem, design(problem, 3, seed, starts=4)) for seed in range(2)]
    assert max(found) < 0.95
    assert max(found) < 1.05 * min(found)


@pytest.mark.slow
def test_errors_on_unseen_mixtures(make):
    for decoder, limit in (("affine", 1.12), ("quadratic", 0.10)):
        problem = make(exact.MIXTURES, decoder=decoder)
        unseen = replace(make(exact.UNSEEN), decoder=decoder)
        assert error(problem, design(problem, 3, starts=4), unseen) < limit


@pytest.mark.slow
def test_a_fitted_response_gives_layouts_as_good_as_the_true_one(make):
    """Slope and curvature of the fitted response deviate a little, as after a calibration."""
    spec = {True: {"k": 2.0, "q": 8.0}, False: {"k": 1.94, "q": 9.0}}
    true, fitted = (
        replace(
            make(exact.MIXTURES, noise=0.002),
            sense=SignalModel(
                build_response(ResponseSpec("quadratic", spec[t], (-0.07, 0.07))), local=True
            ),
        )
        for t in (True, False)
    )
    best = error(true, design(true, 3, starts=2))
    assert error(true, design(fitted, 3, starts=2)) == pytest.approx(best, rel=0.03)
