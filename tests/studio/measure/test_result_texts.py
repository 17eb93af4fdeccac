"""Texts of the results of trainings, evaluations and fits, of given numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from defsense_fab.studio.measure.jobs import EvaluationResult, TrainingResult
from defsense_fab.studio.measure.result_texts import (
    decoder_error_text,
    decoder_table,
    evaluation_text,
    relative_name,
    response_text,
    training_text,
)
from defsense_fab.workflow.train.evaluation import Measures

METADATA = {
    "decoder": "kernel",
    "pictures": {"trained": 70, "tested": 30},
    "candidates": [
        {"decoder": "affine", "cross_validated": 1.5, "test": None},
        {
            "decoder": "kernel",
            "cross_validated": 0.75,
            "test": {"rmse": 0.8, "sd": 0.2, "peak": 3.25, "average_peak": 1.0},
        },
    ],
}


def test_training_text_has_the_errors_of_the_decoders_and_the_notes():
    text = training_text(TrainingResult("/d/model.json", METADATA, ("few",)))
    assert "`/d/model.json`" in text
    assert "| **kernel** | 0.75 | 0.80 | 3.25 |" in text
    assert "| affine | 1.50 | - | - |" in text
    assert text.endswith("- few")


def test_training_text_names_the_data_of_a_model_without_a_session():
    text = training_text(TrainingResult("m.json", {"trained_on": "20 simulated states"}))
    assert "20 simulated states" in text


@pytest.mark.parametrize("metadata", [{}, {"candidates": []}])
def test_a_model_without_errors_has_no_table(metadata):
    assert decoder_table(metadata) == ""
    assert decoder_error_text(metadata) == ""


def test_decoder_error_text_has_the_error_of_the_chosen_decoder():
    assert "0.80 mm" in decoder_error_text(METADATA)


def test_evaluation_text_has_the_errors_and_the_report():
    text = evaluation_text(EvaluationResult("/d/page.html", Measures(0.8, 0.2, 3.0, 1.0, 30)))
    assert "| 0.80 ± 0.20 | 3.00 | 1.00 | 30 |" in text
    assert "`/d/page.html`" in text


def test_response_text_has_the_gain_and_its_interval():
    data = {
        "k_res": 2.0,
        "interval": (1.9, 2.1),
        "strain_range": (-0.05, 0.05),
        "reason": "linear fits best",
        "readings": 24,
        "pieces": ["a", "b"],
        "warnings": ["few"],
    }
    lines = response_text(data, Path("/d/response.html")).split("\n\n")
    assert "k_res = 2.00" in lines[0]
    assert "1.90" in lines[0]
    assert "2.10" in lines[0]
    assert lines[1] == "linear fits best"
    assert "`/d/response.html`" in lines[2]
    assert lines[3] == "- few"


def test_paths_in_the_device_folder_are_relative():
    assert relative_name("/d/bar/session", Path("/d/bar")) == "session"
    assert relative_name("/elsewhere/session", Path("/d/bar")) == "/elsewhere/session"
