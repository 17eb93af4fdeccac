"""Sessions are chosen, and models trained and evaluated, on the page."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.store.layout import layout_hash, load_layout
from defsense_fab.studio.measure import jobs
from defsense_fab.studio.workbench.background_job import CANCELLED, BackgroundJob
from defsense_fab.training.fitting.model_file import load_model
from defsense_fab.workflow.train.evaluation import Measures
from defsense_fab.workflow.train.options import TwinOptions
from tests.studio.devices import InlineProcess

TIMEOUT_S = 600.0


def write_session(folder, layout, device="bar", *, is_processed=True):
    """Write the files of a session that are read before it is used for training."""
    folder.mkdir()
    manifest = {
        "schema": 1,
        "device": device,
        "begun": "2026-11-25",
        "channels": ["a"],
        "reference": [1.0],
        "steps": [],
        "unit": "1",
        "layout": layout,
    }
    (folder / "session.json").write_text(json.dumps(manifest), encoding="utf-8")
    if is_processed:
        (folder / "quality.json").write_text('{"frames": 90, "seconds": 3.0}', encoding="utf-8")
        (folder / "aligned.csv").write_text("", encoding="utf-8")


@pytest.fixture
def folder(studio_page):
    return studio_page.bench.project.folder


@pytest.fixture
def training(studio_page, folder):
    layout = layout_hash(load_layout(folder / "build"))
    write_session(folder / "first", layout)
    write_session(folder / "other", "0" * 16)
    write_session(folder / "raw", layout, is_processed=False)
    studio_page.enter("Measure")
    part = studio_page.modes["Measure"].training
    assert part.wait_for_sessions(TIMEOUT_S)
    part.job.process = InlineProcess(part.job.end)
    return part


def test_usable_sessions_are_offered_and_new_ones_are_chosen(training, folder):
    assert [p.name for p in training.offered] == ["first"]
    codes = {s.folder.name: s.code for s in training.sessions if not s.is_usable}
    assert codes == {"other": "layouts-differ", "raw": "session-not-processed"}
    assert not training.can_process  # the unprocessed session has no recorded runs
    write_session(folder / "second", "")
    training.refresh()
    assert training.wait_for_sessions(TIMEOUT_S)
    assert [p.name for p in training.offered] == ["first", "second"]
    assert [p.name for p in training.chosen] == ["first", "second"]


def test_a_model_is_trained_on_the_chosen_sessions(training, folder, monkeypatch):
    calls = []
    result = jobs.TrainingResult("/d/model.json", {})

    def train(folder, sessions, progress):
        calls.append((folder, sessions))
        return result

    monkeypatch.setattr(jobs, "train", train)
    training.train()
    assert calls == [(folder, [folder / "first"])]
    assert training.result is result
    training.choose([])
    training.train()
    assert training.status.code == "no-session-chosen"
    assert len(calls) == 1


def test_the_error_of_a_training_is_shown(training, monkeypatch):
    def train(folder, sessions, progress):
        raise TrainingError("has too few frames", code="too-few-frames", where="first")

    monkeypatch.setattr(jobs, "train", train)
    training.train()
    assert training.status.code == "too-few-frames"
    assert not training.job.shows_progress


def test_the_report_of_an_evaluation_can_be_downloaded(training, monkeypatch, tmp_path):
    page = tmp_path / "evaluation.html"
    page.write_text("<p>report</p>", encoding="utf-8")
    result = jobs.EvaluationResult(str(page), Measures(0.8, 0.2, 3.0, 1.0, 30))
    monkeypatch.setattr(jobs, "evaluate", lambda *_, **__: result)
    assert not training.can_download
    training.evaluate()
    assert training.result is result
    assert training.can_download
    sent = []
    client = SimpleNamespace(send_file_download=lambda name, content: sent.append((name, content)))
    training.send_page(client)
    assert sent == [("evaluation.html", b"<p>report</p>")]
    page.unlink()
    training.send_page(client)
    assert training.status.code == "file-unreadable"
    assert len(sent) == 1


def test_a_simulated_session_does_not_replace_another(training, folder, monkeypatch):
    calls = []

    def record(folder, options, progress):
        calls.append(options)
        session = folder / f"twin-{options.unit}-{options.seed}"
        session.mkdir()
        return [str(session)]

    monkeypatch.setattr(jobs, "record_twin", record)
    (folder / "twin-1-1").mkdir()
    training.set_twin(minutes=2.0)
    training.record_twin()
    assert training.status.code == "file-exists"
    training.set_twin(seed=2)
    training.record_twin()
    assert calls == [TwinOptions(minutes=2.0, seed=2)]
    assert training.result == [str(folder / "twin-1-2")]
    assert training.twin_seed == 3


def test_a_device_without_a_build_has_no_twin(training, folder):
    (folder / "build" / "layout.json").unlink()
    training.record_twin()
    assert training.status.code == "not-built"


@pytest.mark.slow
def test_a_model_of_the_simulation_is_trained_in_a_process_and_canceled(training, folder):
    ended, results = threading.Event(), []

    def end(error, result):
        results.append((error, result))
        ended.set()

    (folder / "model.json").unlink()
    training.job.process = BackgroundJob("job", lambda *_: None, end)
    training.train_on_simulation()
    training.train()
    assert training.status.code == "busy"
    assert ended.wait(TIMEOUT_S)
    error, result = results[0]
    assert error is None
    assert Path(result.path) == (folder / "model.json").resolve()
    assert "trained_on" in load_model(folder / "model.json").metadata
    ended.clear()
    training.train_on_simulation()
    training.job.process.cancel()
    assert ended.wait(TIMEOUT_S)
    assert (results[1][0].code, results[1][1]) == (CANCELLED, None)
