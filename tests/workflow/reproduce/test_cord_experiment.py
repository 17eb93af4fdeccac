"""Cords alone."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.progress import silent
from defsense_fab.workflow.reproduce import cord_experiment
from defsense_fab.workflow.reproduce.cord_experiment import run_cord_experiment, make_true_response
from defsense_fab.workflow.reproduce.cord_experiment import StretchedCord, stretch_cord
from defsense_fab.workflow.reproduce.experiments.examples import find_experiments


@pytest.fixture(scope="module")
def plan():
    (found,) = find_experiments(["cord"])
    return replace(found.cords, lengths=(150.0,), radii=(75.0, 100.0, 150.0, 250.0), rounds=2)


def test_the_example_finds_the_twins_slope(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(cord_experiment, "QUICK_SEEDS", 1)
    found = run_cord_experiment(plan, True, tmp_path, silent)
    cord = found["cords"]["ecord"]
    assert cord["k_res"] == [pytest.approx(plan.k_res, rel=0.1)]
    assert found["pictures"]["fit"].startswith("data:image/png;base64,")
    assert "k_res" not in found["cords"]["etpu"]
    slope = (make_true_response(2.0)(np.array(1e-3)) - make_true_response(2.0)(np.array(-1e-3))) / 2e-3
    assert slope == pytest.approx(2.0, rel=1e-3)


def test_hysteresis_and_repeatability_are_what_was_put_in(plan):
    run = stretch_cord(plan, "ecord", 1)
    assert run.strain.max() == pytest.approx(plan.strain, rel=0.01)
    back = np.gradient(run.strain, run.time) < 0
    lagging = 10 * run.strain + 0.04 * back * (run.strain > 0)
    alike = StretchedCord(run.time, run.strain, np.stack([lagging, lagging]))
    assert alike.repeatability == 0
    assert alike.hysteresis == pytest.approx(0.02 / lagging.max(), rel=0.05)
    shifted = StretchedCord(run.time, run.strain, np.stack([lagging, lagging + 0.1]))
    assert shifted.repeatability == pytest.approx(0.1 / (lagging.max() + 0.1))
