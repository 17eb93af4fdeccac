"""Sessions are chosen, models trained and evaluated, beside the page."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.store.layout import layout_hash, load_layout
from defsense_fab.studio.measure import jobs
from defsense_fab.studio.measure.result_texts import decoder_table
from defsense_fab.studio.workbench.background_job import CANCELLED, BackgroundJob
from defsense_fab.training.models.model_file import load_model

LONG = 60.0
TOLD = {
    "decoder": "kernel",
    "pictures": {"trained": 70, "tested": 30},
    "candidates": [
        {"decoder": "affine", "cross_validated": 1.5, "test": None},
        {"decoder": "kernel", "cross_validated": 0.75,
         "test": {"rmse": 0.8, "sd": 0.2, "peak": 3.25, "average_peak": 1.0}},
    ],
}  # fmt: skip


def write_session(folder, layout, device="bar", *, processed=True):
    """As far as it is looked at before it is trained on."""
    folder.mkdir()
    said = {
        "schema": 1, "device": device, "begun": "2026-11-25", "channels": ["a"],
        "reference": [1.0], "steps": [], "unit": "1", "layout": layout,
    }  # fmt: skip
    (folder / "session.json").write_text(json.dumps(said), encoding="utf-8")
    if processed:
        (folder / "quality.json").write_text('{"frames": 90, "seconds": 3.0}', encoding="utf-8")
        (folder / "aligned.csv").write_text("", encoding="utf-8")


class Inline:
    """In place of a process."""

    running = False

    def __init__(self, part):
        self.part = part

    def start(self, run, job):
        try:
            result = job(lambda *_: None)
        except TrainingError as error:
            self.part._ended(error, None)
        else:
            self.part._ended(None, result)
        return True

    def cancel(self):
        pass

    close = cancel


@pytest.fixture
def training(studio_page):
    folder = studio_page.bench.project.folder
    layout = layout_hash(load_layout(folder / "build"))
    write_session(folder / "first", layout)
    write_session(folder / "other", "0" * 16)
    write_session(folder / "raw", layout, processed=False)
    studio_page.enter("Measure")
    part = studio_page.modes["Measure"].training
    assert part.looked(LONG)
    part.work = Inline(part)
    return part


def test_sessions_that_can_be_trained_on_are_offered_and_others_say_why_not(training):
    assert [p.name for p in training._boxes] == ["first"]
    told = training._rows[-1].content
    assert "`other` was recorded with other cords" in told
    assert "`raw` is not processed; run 'defsense capture process" in told
    count = len(training._folder._children)
    write_session(training._bench.project.folder / "second", "")
    training.refresh()
    assert training.looked(LONG)
    assert [p.name for p in training._boxes] == ["first", "second"]
    assert len(training._folder._children) == count + 1
    assert [p.name for p in training.chosen] == ["first", "second"]


def test_a_training_shows_its_table_and_its_model(training, monkeypatch):
    asked = []

    def train(folder, sessions, progress):
        asked.append((folder, sessions))
        return {"path": "/d/model.json", "told": TOLD, "notes": ["few"]}

    monkeypatch.setattr(jobs, "train", train)
    training.train()
    folder = training._bench.project.folder
    assert asked == [(folder, [folder / "first"])]
    told = training._result.content
    assert "Wrote `/d/model.json`" in told
    assert "| **kernel** | 0.75 | 0.80 | 3.25 |" in told
    assert "| affine | 1.50 | - | - |" in told
    assert told.endswith("- few")
    for box in training._boxes.values():
        box.value = False
    training.train()
    assert "Choose a session" in training._told.content
    assert len(asked) == 1


def test_what_goes_wrong_is_told_there(training, monkeypatch):
    def train(folder, sessions, progress):
        raise TrainingError("first: has too few frames; record for longer")

    monkeypatch.setattr(jobs, "train", train)
    training.train()
    assert training._told.content == "**first: has too few frames; record for longer**"
    assert not training._bar.visible


def test_an_evaluation_s_page_can_be_had(training, monkeypatch, tmp_path):
    page = tmp_path / "evaluation.html"
    page.write_text("<p>all of it</p>", encoding="utf-8")
    numbers = {"RMSE": 0.8, "SD": 0.2, "peak": 3.0, "average peak": 1.0, "frames": 30}
    monkeypatch.setattr(
        jobs, "evaluate", lambda *_: {"page": str(page), "numbers": numbers, "notes": []}
    )
    assert not training._open.visible
    training.evaluate()
    assert f"`{page}`" in training._result.content
    assert training._open.visible
    sent = []
    client = SimpleNamespace(send_file_download=lambda name, content: sent.append((name, content)))
    training._send(client)
    assert sent == [("evaluation.html", b"<p>all of it</p>")]
    page.unlink()
    training._send(client)
    assert "cannot be read" in training._told.content


def test_a_twin_s_session_is_not_written_over_another(training, monkeypatch):
    asked = []

    def record(folder, minutes, unit, seed, progress):
        asked.append((minutes, unit, seed))
        return [str(folder / f"twin-{unit}-{seed}")]

    monkeypatch.setattr(jobs, "record_twin", record)
    (training._bench.project.folder / "twin-1-1").mkdir()
    training._minutes.value = 2.0
    training.record_twin()
    assert "`twin-1-1` is there already" in training._told.content
    training._seed.value = 2
    training.record_twin()
    assert asked == [(2.0, 1, 2)]
    assert training._result.content == "Recorded `twin-1-2`: *Train* on it."


def test_without_a_build_there_is_no_twin(training):
    (training._bench.project.folder / "build" / "layout.json").unlink()
    training.record_twin()
    assert "build it under *Make*" in training._told.content


def test_a_model_that_tells_nothing_has_no_table():
    assert decoder_table({}) == ""


@pytest.mark.slow
def test_a_model_of_the_simulation_is_made_in_a_process_and_work_is_cancelled(training):
    over, ended = threading.Event(), []

    def end(problem, result):
        ended.append((problem, result))
        over.set()

    part, folder = training, training._bench.project.folder
    (folder / "model.json").unlink()
    part.work = BackgroundJob("work", part._progress, end)
    part.simulate()
    part.train()
    assert "Something is under way" in part._told.content
    assert over.wait(LONG)
    problem, result = ended[0]
    assert problem is None
    assert Path(result["path"]) == (folder / "model.json").resolve()
    assert "simulated states" in load_model(folder / "model.json").metadata["trained_on"]
    over.clear()
    part.simulate()
    part.work.cancel()
    assert over.wait(LONG)
    assert (ended[1][0].code, ended[1][1]) == (CANCELLED, None)
