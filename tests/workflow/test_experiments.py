"""Experiments and calibrations in the Python interface."""

import pytest

import defsense_fab as df
from defsense_fab.core.errors import CalibrationError, ExperimentError
from tests.support.errors import raises
from tests.support.places import ROOT


def test_experiment_is_loaded_at_its_small_size():
    experiment = df.load_experiment(ROOT / "examples" / "bar", quick=True, units=1)
    assert isinstance(experiment, df.Experiment)
    assert experiment.quick
    assert experiment.session.units == 1
    assert not df.load_experiment(ROOT / "examples" / "bar").quick


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("",), "not-a-path"),
        ((ROOT / "tests",), "file-not-found"),
    ],
)
def test_invalid_folder_of_an_experiment_is_refused(arguments, code):
    with raises(ExperimentError, code):
        df.load_experiment(*arguments)


def test_experiment_must_be_loaded(tmp_path):
    with raises(ExperimentError, "wrong-kind", argument="experiment"):
        df.reproduce("examples/bar", tmp_path)


@pytest.mark.slow
def test_simulated_specimen_is_fitted(tmp_path):
    sessions = df.simulate_specimens(tmp_path / "twin", k=2.0, lengths=[150], seed=2)
    fitted = df.fit_response(sessions, tmp_path / "response.json")
    assert isinstance(fitted, df.FittedResponse)
    assert fitted.data["k_res"] == pytest.approx(2.0, abs=0.15)
    low, high = fitted.data["interval"]
    assert low < fitted.data["k_res"] < high
    assert (tmp_path / "response.html").is_file()
    assert df.fit_response(sessions, model="quadratic").data["model"] == "quadratic"
    with raises(CalibrationError, "out-of-range"):
        df.fit_response(sessions, spread=51)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"k": 1e3}, "out-of-range"),
        ({"response": "line"}, "wrong-kind"),
        ({"k_res": 2.0}, "argument-unknown"),
    ],
)
def test_invalid_specimen_is_refused(tmp_path, options, code):
    with raises(CalibrationError, code):
        df.simulate_specimens(tmp_path / "twin", **options)
    assert not (tmp_path / "twin").exists()


def test_sources_must_be_a_list():
    with raises(CalibrationError, "not-a-list", argument="sources"):
        df.fit_response("specimen")
