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


def test_specimen_twin_is_recorded_and_fitted(tmp_path):
    session = df.record_specimen_twin(tmp_path / "specimen", k_res=2.0, length=150, seed=150)
    fitted = df.fit_response([session], tmp_path / "response.json")
    assert isinstance(fitted, df.FittedResponse)
    assert fitted.data["k_res"] == pytest.approx(2.0, abs=0.15)
    low, high = fitted.data["interval"]
    assert low < fitted.data["k_res"] < high
    assert (tmp_path / "response.html").is_file()


def test_invalid_slope_is_refused(tmp_path):
    with raises(CalibrationError, "not-a-number", argument="k_res"):
        df.record_specimen_twin(tmp_path / "specimen", k_res=-1)


def test_sources_must_be_a_list():
    with raises(CalibrationError, "not-a-list", argument="sources"):
        df.fit_response("specimen")
