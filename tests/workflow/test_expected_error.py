"""Evaluations compare the measured error with the one that the design expects after training."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from defsense_fab.training.evaluation.evaluate_models import evaluate_models
from defsense_fab.training.evaluation.predicted_error import DesignPrediction, PredictedError
from defsense_fab.workflow.train.evaluation import compare_with_design
from tests.store.layouts import BAND
from tests.training import soft_bar as bar

BUILD = SimpleNamespace(layout=SimpleNamespace(band=BAND))


@pytest.fixture(scope="module")
def result():
    data = bar.dataset(bar.recording(60, noise=0.002, sigma=0.15))
    other = bar.dataset(replace(bar.recording(60, seed=2, noise=0.002, sigma=0.15), session="b"))
    return evaluate_models([("plain", bar.trained(data))], other)


def with_design(result, design):
    predicted = PredictedError(design, {}, 1.0, 0.5)
    return replace(result, models=(replace(result.models[0], predicted=predicted),))


def test_the_measured_error_is_compared_without_the_noise_of_cameras(result):
    evaluation = result.models[0].evaluation
    assert evaluation.rmse_without_noise < evaluation.total.rmse
    text = compare_with_design(with_design(result, DesignPrediction(1.0, 0.1, 0.9, 1.1)), BUILD)
    assert text == BAND.compare_measured(evaluation.rmse_without_noise)


@pytest.mark.parametrize("cords", ["viscoelastic", "hysteretic"])
def test_a_twin_is_compared_with_the_error_expected_with_its_cords(result, cords, tmp_path):
    (tmp_path / "quality.json").write_text(f'{{"twin": {{"twin": true, "cords": "{cords}"}}}}')
    twin = replace(result, sessions=(str(tmp_path),))
    measured = result.models[0].evaluation.rmse_without_noise
    design = DesignPrediction(1.0, 0.1, 0.9, 1.1)
    text = compare_with_design(with_design(twin, design), BUILD)
    assert text == BAND.compare_measured(measured, cords)
    assert cords in text
    mixed = replace(twin, sessions=(str(tmp_path), "recorded"))
    assert compare_with_design(with_design(mixed, design), BUILD) == BAND.compare_measured(measured)


def test_a_model_of_another_layout_is_not_compared(result):
    assert compare_with_design(with_design(result, None), BUILD) == ""
    assert compare_with_design(result, BUILD) == ""
