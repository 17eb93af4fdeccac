"""Cords that differ between the training and the test data."""

import json
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.cli.main import main
from defsense_fab.report.evaluation import evaluation_report
from defsense_fab.training.evaluation.evaluate_models import note_changed_cords
from defsense_fab.training.fitting.model_file import write_model
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.recordings.dataset_parquet import write_dataset
from defsense_fab.workflow.train.training import train_dataset
from tests.training import soft_bar as bar


@pytest.fixture(scope="module")
def model():
    data = bar.dataset(bar.recording(40, noise=0.002, sigma=0.15))
    return train_dataset(data, TrainOptions("quadratic", memory=False)).model


def later(scale, **changes):
    r = bar.recording(40, seed=2, noise=0.002, sigma=0.15)
    changes = {"ohm": r.ohm * scale, "rest": r.rest * scale, "session": "session-2"} | changes
    return bar.dataset(replace(r, **changes))


def test_a_changed_resistance_at_rest_is_noted(model):
    (note,) = note_changed_cords("m", model, later([1.0, 1.5, 1.0]))
    assert all(word in note for word in ("session-2", "lower", "1.50"))
    for same in (
        later([1.0, 1.05, 1.0]),
        later([1.3, 1.3, 1.3]),  # another temperature
        later([1.0, 1.5, 1.0], unit="unit-2"),  # another built device
        later(1.0, rest=np.ones(3), ohm=1 + bar.recording(40, seed=2).signals),
    ):
        assert note_changed_cords("m", model, same) == []


def test_an_evaluation_notes_problems_of_its_data(model, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(evaluation_report, "svg_figures", lambda _: {})
    r = later([1.0, 1.5, 1.0]).recordings[0]
    write_dataset(tmp_path / "data", bar.dataset(replace(r, sample_time=r.sample_time + 0.5)))
    write_model(tmp_path / "model.json", model)
    words = ["evaluate", str(tmp_path / "model.json"), str(tmp_path / "data"), "--json"]
    assert main(words) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert any("run-1" in n and "shift" in n for n in notes)
    assert any("lower" in n and "1.50" in n for n in notes)
