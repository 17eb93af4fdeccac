"""Sessions are recorded and processed, models trained and evaluated, responses fitted and used."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.core.response import ResponseSpec
from defsense_fab.store.layout import layout_hash, load_layout
from defsense_fab.studio.messages import measure as messages
from defsense_fab.studio.steps.measure import jobs, training
from defsense_fab.workflow.train.evaluation import Measures
from defsense_fab.workflow.train.options import TwinOptions
from tests.studio.steps.measure_page import MeasurePage, write_session, write_specimen

TWIN = {"minutes": 2.0, "unit": 1, "seed": 1, "cords": ""}


@pytest.fixture
def page(live_bar, tmp_path):
    folder = tmp_path / "bar"
    shutil.copytree(live_bar.folder, folder)
    layout = layout_hash(load_layout(folder / "build"))
    write_session(folder / "first", layout)
    write_session(folder / "other", "0" * 16)
    write_session(folder / "raw", layout, is_processed=False)
    page = MeasurePage(folder)
    yield page
    page.close()


def test_sessions_models_and_boards_are_offered(page):
    choices = page.refresh()
    assert {s.name: bool(s.problem) for s in choices.sessions} == {
        "first": False,
        "other": True,
        "raw": True,
    }
    assert [m.name for m in choices.models] == ["model.json"]
    assert choices.models[0].problem == ""
    assert (choices.ports[0].port, choices.ports[0].is_board) == ("twin", True)
    assert any(p.port.startswith("replay:") and not p.is_board for p in choices.ports)
    assert (choices.is_built, choices.free_seed, choices.has_tags) == (True, 1, False)
    assert page.server.events[messages.MeasureChoices] == choices


def test_new_sessions_are_found_after_a_change_of_the_device(page):
    page.refresh()
    write_session(page.folder / "second", "")
    page.step.on_device_changed()
    assert page.step.wait(60)
    assert "second" in [s.name for s in page.step.choices.sessions]


def test_a_model_is_trained_on_the_chosen_sessions(page, monkeypatch):
    calls = []
    metadata = {
        "decoder": "affine",
        "candidates": [
            {"decoder": "affine", "cross_validated": 1.5, "test": {"rmse": 1.25, "peak": 4.0}},
            {"decoder": "quadratic", "cross_validated": 2.0, "test": None},
        ],
        "pictures": {"trained": 80, "tested": 20},
    }

    def train(folder, sessions, progress):
        calls.append((folder, sessions))
        return jobs.TrainingResult("/d/model.json", metadata, ("a note",))

    monkeypatch.setattr(jobs, "train", train)
    page.send(messages.TrainModel, sessions=["first"])
    assert calls == [(page.folder, [page.folder / "first"])]
    result = page.results.training
    assert result.decoders[0] == messages.DecoderResult(
        decoder="affine", folds=1.5, test=1.25, peak=4.0, is_chosen=True
    )
    assert (result.decoders[1].is_chosen, result.decoders[1].test) == (False, None)
    assert (result.trained_images, result.tested_images, result.notes) == (80, 20, ["a note"])
    assert page.status("train").code == "model-trained"
    assert page.models_written == 1
    page.send(messages.TrainOnSimulation)
    assert calls[1] == (page.folder, [])


@pytest.mark.parametrize(
    ("sessions", "code"), [([], "no-session-chosen"), (["other"], "session-unusable")]
)
def test_unusable_sessions_are_refused(page, sessions, code):
    assert page.refusal(messages.TrainModel, sessions=sessions) == code
    assert page.refusal(messages.EvaluateModel, sessions=sessions) == code
    assert page.jobs.titles == []


def test_the_error_of_a_training_is_shown(page, monkeypatch):
    def train(folder, sessions, progress):
        raise TrainingError("has too few frames", code="too-few-frames", where="first")

    monkeypatch.setattr(jobs, "train", train)
    page.send(messages.TrainModel, sessions=["first"])
    assert page.status("train").problem.code == "too-few-frames"
    assert page.status("train").state == "idle"


def test_a_job_that_cannot_start_leaves_the_status(page, monkeypatch):
    def start(work):
        raise TrainingError("a job runs", code="job-running")

    monkeypatch.setattr(page.jobs, "start", start)
    assert page.refusal(messages.TrainModel, sessions=["first"]) == "job-running"
    assert page.status("train") == messages.TaskStatus()


def test_the_report_of_an_evaluation_can_be_downloaded(page, monkeypatch, tmp_path):
    report = tmp_path / "evaluation.html"
    report.write_text("<p>report</p>", encoding="utf-8")
    result = jobs.EvaluationResult(str(report), Measures(0.8, 0.2, 3.0, 1.0, 30))
    monkeypatch.setattr(jobs, "evaluate", lambda *_, **__: result)
    assert page.step.download("measure/evaluation.html") is None
    page.send(messages.EvaluateModel, sessions=["first"])
    assert (page.results.evaluation.rmse, page.results.evaluation.frames) == (0.8, 30)
    assert page.step.download("measure/evaluation.html").content == b"<p>report</p>"
    report.unlink()
    assert page.step.download("measure/evaluation.html") is None


def test_a_device_without_a_model_is_not_evaluated(page):
    (page.folder / "model.json").unlink()
    assert page.refusal(messages.EvaluateModel, sessions=["first"]) == "no-model"


def test_a_simulated_session_does_not_replace_another(page, monkeypatch):
    calls = []

    def record(folder, options, progress):
        calls.append(options)
        session = folder / f"twin-{options.unit}-{options.seed}"
        session.mkdir()
        return [str(session)]

    monkeypatch.setattr(jobs, "record_twin", record)
    (page.folder / "twin-1-1").mkdir()
    assert page.refusal(messages.RecordTwin, **TWIN) == "file-exists"
    assert page.refresh().free_seed == 2
    page.send(messages.RecordTwin, **{**TWIN, "seed": 2})
    assert calls == [TwinOptions(minutes=2.0, seed=2)]
    assert "twin-1-2" in page.status("record").text
    assert page.refresh().free_seed == 3


def test_a_twin_needs_a_build_and_a_known_family_of_cords(page):
    assert page.refusal(messages.RecordTwin, **{**TWIN, "cords": "steel"}) == "unknown-cords"
    (page.folder / "build" / "layout.json").unlink()
    assert page.refusal(messages.RecordTwin, **TWIN) == "not-built"


def test_recordings_are_processed(page, monkeypatch):
    assert page.refusal(messages.ProcessSessions) == "nothing-to-process"
    (page.folder / "raw" / "run-1").mkdir()
    (page.folder / "raw" / "run-1" / "board.csv").write_text("", encoding="utf-8")
    calls = []
    monkeypatch.setattr(jobs, "process", lambda s, progress: calls.append(s) or ["`raw`: 9 frames"])
    page.send(messages.ProcessSessions)
    assert calls == [[page.folder / "raw"]]
    assert page.status("train").text == "raw: 9 frames"


def test_tags_are_made(page, monkeypatch):
    monkeypatch.setattr(jobs, "make_tags", lambda folder, progress: ["12 tags"])
    page.send(messages.MakeTags)
    assert page.status("record").code == "tags-made"
    assert "12 tags" in page.status("record").text


def test_tags_are_not_written_through_a_link(page, tmp_path):
    (tmp_path / "other").mkdir()
    (page.folder / "markers").symlink_to(tmp_path / "other")
    assert page.refusal(messages.MakeTags) == "outside-device-folder"


def test_the_response_is_fitted_and_used_until_it_is_undone(page, monkeypatch):
    assert page.refusal(messages.FitResponse) == "no-specimen"
    assert page.refusal(messages.UseResponse) == "no-response"
    write_specimen_session(page.folder / "specimen-twin-150")
    used = []
    data = {
        "k_res": 2.0,
        "interval": [1.9, 2.1],
        "reason": "the simplest",
        "strain_range": [-0.05, 0.05],
        "readings": 24,
        "pieces": ["a"],
        "warnings": [],
    }

    def fit(sources, out, progress=None):
        used.append([p.name for p in sources])
        return Fit(data, page.folder / "response.html")

    monkeypatch.setattr("defsense_fab.workflow.calibrate.fit_response.fit_response", fit)
    page.send(messages.FitResponse)
    assert page.results.response.is_simulated
    write_specimen_session(page.folder / "mine")
    page.send(messages.FitResponse)
    assert used == [["specimen-twin-150"], ["mine"]]
    assert page.results.response.k_res == 2.0
    assert not page.results.response.is_simulated
    before = page.session.project.text
    (page.folder / "response.json").write_text(json.dumps(RESPONSE), encoding="utf-8")
    page.send(messages.UseResponse)
    assert page.session.project.text != before
    assert not page.results.response.can_use
    page.session.project.undo()
    assert page.session.project.text == before


def test_specimens_are_simulated(page, monkeypatch):
    simulated = [Path("specimen-twin-150")]
    monkeypatch.setattr(training, "simulate_specimens", lambda *_, **__: simulated)
    page.send(messages.SimulateSpecimens)
    assert page.status("specimen").code == "specimens-simulated"
    assert "specimen-twin-150" in page.status("specimen").text


def test_a_specimen_outside_of_the_folder_is_refused(page):
    write_specimen(page.folder)
    code = page.refusal(messages.MeasureSpecimen, port="twin", specimen="../other")
    assert code == "outside-device-folder"


class Fit:
    """A fitted response."""

    def __init__(self, data, page):
        self.data, self.page = data, page


RESPONSE = {"schema": 1, **ResponseSpec("quadratic", {"k": 2.0, "q": 0.0}, (-0.1, 0.1)).to_json()}


def write_specimen_session(folder):
    folder.mkdir()
    (folder / "session.json").write_text('{"specimen": {}}', encoding="utf-8")
