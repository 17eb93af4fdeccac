"""Experiments with cords alone."""

import numpy as np
import pytest
from msgspec import structs

from defsense_fab.core.progress import silent
from defsense_fab.sensing.response import build_response
from defsense_fab.workflow.reproduce import cord_experiment
from defsense_fab.workflow.reproduce.cord_experiment import (
    StretchedCord,
    make_true_response,
    run_cord_experiment,
    stretch_cord,
)
from defsense_fab.workflow.reproduce.experiment_file import find_experiments


@pytest.fixture(scope="module")
def plan():
    (experiment,) = find_experiments(["cord"])
    radii = (75.0, 100.0, 150.0, 250.0)
    return structs.replace(experiment.file.cords, lengths=(150.0,), radii=radii, rounds=2)


def test_calibration_finds_the_slope_of_the_twin(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(cord_experiment, "QUICK_SEEDS", 1)
    results = run_cord_experiment(plan, True, tmp_path, silent)
    cord = results["cords"]["ecord"]
    assert cord["k_res"] == [pytest.approx(plan.k_res, rel=0.1)]
    assert results["pictures"]["fit"].startswith("data:image/png;base64,")
    assert "k_res" not in results["cords"]["etpu"]
    response = build_response(make_true_response(2.0))
    slope = (response(np.array(1e-3)) - response(np.array(-1e-3))) / 2e-3
    assert slope == pytest.approx(2.0, rel=1e-3)


def test_hysteresis_and_repeatability_of_known_signals(plan):
    run = stretch_cord(plan, "ecord", 1)
    assert run.strain.max() == pytest.approx(plan.strain, rel=0.01)
    is_back = np.gradient(run.strain, run.time) < 0
    signal = 10 * run.strain + 0.04 * is_back * (run.strain > 0)
    equal = StretchedCord(run.time, run.strain, np.stack([signal, signal]))
    assert equal.repeatability == 0
    assert equal.hysteresis == pytest.approx(0.02 / signal.max(), rel=0.05)
    shifted = StretchedCord(run.time, run.strain, np.stack([signal, signal + 0.1]))
    assert shifted.repeatability == pytest.approx(0.1 / (signal.max() + 0.1))
