"""The folder of an evaluation: page, figures and tables agree with the records."""

import csv
import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import StorageError, TrainingError
from defsense_fab.decoding.signal_history import Past
from defsense_fab.report.evaluation import evaluation_report
from defsense_fab.report.evaluation.evaluation_report import write_evaluation
from defsense_fab.training.data.dataset import recording_fingerprint
from defsense_fab.training.evaluation.evaluate_models import evaluate_models
from defsense_fab.workflow.train.evaluation import short_names
from tests.support.errors import raises
from tests.training import soft_bar as bar

pytestmark = pytest.mark.slow

CAUSES = {"noise": 0.002, "sigma": 0.15, "gaps": 0.1, "memory": 0.3}


@pytest.fixture(scope="module")
def models():
    data = bar.dataset(bar.recording(60, **CAUSES))
    memory = bar.trained(data, past=Past((1.0,)), noise=0.002)
    return [("plain", bar.trained(data)), ("with-memory", memory)]


@pytest.fixture(scope="module")
def unseen():
    return bar.dataset(replace(bar.recording(60, seed=2, **CAUSES), session="session-2"))


@pytest.fixture(scope="module")
def result(models, unseen):
    return evaluate_models(models, unseen)


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "evaluation"
    write_evaluation(out, result)
    return out


def rows(folder, name):
    with (folder / name).open() as file:
        return list(csv.DictReader(file))


def test_the_page_is_self_contained(folder, result):
    page = (folder / "evaluation.html").read_text(encoding="utf-8")
    total = result.models[0].evaluation.total
    assert f"RMSE {total.rmse:.2f} &plusmn; {total.deviation:.2f} mm" in page
    assert page.count("data:image/svg+xml;base64,") == 7
    assert not re.findall(r"(?:src|href)=\"(?!data:)", page)
    assert "4.46 &plusmn; 1.76</td><td>21.78</td><td>8.98" in page
    assert "with-memory" in evaluation_report.verdict(result.comparison)
    assert evaluation_report.verdict(result.comparison) in html.unescape(page)


def test_tables_agree_with_the_records(folder, result):
    table = rows(folder, "table-1.csv")
    assert [r["model"] for r in table[:2]] == ["plain", "with-memory"]
    for row, model in zip(table, result.models, strict=False):
        assert float(row["rmse_mm"]) == pytest.approx(model.evaluation.total.rmse, rel=1e-5)
    assert [float(r["rmse_mm"]) for r in table[2:]] == [4.46, 3.66, 1.17]
    frames = [r for r in rows(folder, "frames.csv") if r["model"] == "plain"]
    assert len(frames) == result.models[0].evaluation.total.frames
    mean = sum(float(r["error_mm"]) ** 2 for r in frames) / len(frames)
    assert mean**0.5 == pytest.approx(result.models[0].evaluation.total.rmse, rel=1e-4)
    budget = [r for r in rows(folder, "error-budget.csv") if r["model"] == "plain"]
    assert {r["how"] for r in budget} == {"fitted"}
    assert sum(float(r["mean_square_mm2"]) for r in budget[:-1]) == pytest.approx(
        float(budget[-1]["mean_square_mm2"]), rel=1e-4
    )
    [test] = rows(folder, "comparison.csv")
    [expected] = result.comparison.tests
    assert (test["first"], test["second"]) == ("plain", "with-memory")
    assert float(test["difference_mm"]) == pytest.approx(expected.difference, rel=1e-4)


def test_numbers_for_programs(folder, result):
    data = json.loads((folder / "evaluation.json").read_text(encoding="utf-8"))
    plain = data["models"]["plain"]
    assert plain["errors"]["frames"] == result.models[0].evaluation.total.frames
    assert set(plain["poses"]) == {"bend", "twist", "bend and twist"}
    assert data["comparison"]["tests"][0]["p"] == result.comparison.tests[0].p < 1e-6


def test_figures_are_one_column_wide(folder):
    for path in folder.glob("*.svg"):
        head = path.read_text(encoding="utf-8")[:1500]
        width = float(re.search(r'width="([\d.]+)pt"', head)[1])
        assert width == pytest.approx(85 / 25.4 * 72, rel=1e-3)
    assert len(list(folder.glob("*.svg"))) == 7


def test_writing_again_gives_the_same_files(folder, result, tmp_path):
    again = tmp_path / "again"
    write_evaluation(again, result)
    for path in again.iterdir():
        assert path.read_bytes() == (folder / path.name).read_bytes(), path.name


def test_a_failed_write_leaves_the_previous_evaluation(result, tmp_path, monkeypatch):
    """The previous evaluation stays, without temporary files, if the page cannot be written."""
    monkeypatch.setattr(evaluation_report, "svg_figures", lambda _: {"paths": "<svg/>"})
    out = tmp_path / "evaluation"
    write_evaluation(out, result)
    before = sorted((p.name, p.stat().st_mtime_ns) for p in out.iterdir())

    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as broken:
        broken.setattr(evaluation_report, "write_page", fail)
        with raises(StorageError, "disk-full"):
            write_evaluation(out, result)
    assert sorted((p.name, p.stat().st_mtime_ns) for p in out.iterdir()) == before
    assert [p.name for p in tmp_path.iterdir()] == ["evaluation"]
    write_evaluation(out, result)
    assert [p.name for p in tmp_path.iterdir()] == ["evaluation"]


def test_other_folders_are_not_overwritten(result, tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    with raises(TrainingError, "not-an-evaluation"):
        write_evaluation(tmp_path, result)
    with raises(TrainingError, "not-an-evaluation"):
        write_evaluation(tmp_path / "thesis.tex", result)


def test_unknown_values_are_not_shown(models, tmp_path):
    """The model has no intervals; noise, poses and one marker are unknown."""
    name, model = models[0]
    model = replace(model, main=replace(model.main, intervals=None))
    run = bar.recording(10, seed=2)
    points = run.points.copy()
    points[:, 0] = float("nan")
    bare = replace(run, points=points, poses=(), sync_error=None, sigma=run.sigma * float("nan"))
    result = evaluate_models([(name, model)], bar.dataset(bare))
    write_evaluation(tmp_path / "out", result)
    page = (tmp_path / "out" / "evaluation.html").read_text(encoding="utf-8")
    data = json.loads((tmp_path / "out" / "evaluation.json").read_text(encoding="utf-8"))
    assert data["comparison"] is None
    assert data["models"][name]["camera_noise"] is None
    assert data["models"][name]["intervals"] is None
    assert "nan" not in re.sub('base64,[^"]*', "", page).lower()
    assert "1 markers were never visible" in page
    assert not (tmp_path / "out" / "coverage.svg").exists()
    assert not (tmp_path / "out" / "comparison.csv").exists()
    assert json.loads((tmp_path / "out" / "evaluation.json").read_text(encoding="utf-8"))["models"]


def test_training_frames_are_left_out(models, unseen):
    """By default, only held-out frames are tested; a note is given if more are requested."""
    name, model = models[0]
    r = unseen.recordings[0]
    begin = float(r.time[len(r.time) * 3 // 4])
    known = {"run": r.name, "fingerprint": recording_fingerprint(r), "after": begin - r.time[0]}
    knowing = [(name, replace(model, metadata={"held_out": [known]}))]
    held = evaluate_models(knowing, unseen)
    assert held.last_share == pytest.approx(0.25, abs=0.01)
    assert held.models[0].evaluation.frames.time.min() >= begin
    assert not any(r.name in note for note in held.notes)
    # A copy under another name is recognized.
    moved = replace(r, name="copy/run-1", session="copy", ohm=r.ohm.copy())
    # Another format rounds numbers, shifts times, and has another R0.
    moved = replace(
        moved,
        ohm=np.round(moved.ohm, 3),
        rest=1.01 * r.rest,
        time=np.round(r.time + 7, 4),
        sample_time=np.round(r.sample_time + 7, 4),
    )
    again = evaluate_models(knowing, replace(unseen, recordings=(moved,)))
    assert again.models[0].evaluation.total.frames == held.models[0].evaluation.total.frames
    every = evaluate_models(knowing, unseen, 1.0)
    assert r.name in every.notes[0]
    none = replace(model, metadata={"held_out": [{**known, "after": None}]})
    with raises(TrainingError, "no-test-frames"):
        evaluate_models([(name, none)], unseen)


def test_the_predicted_error_is_shown(models, unseen, tmp_path):
    """It is shown only for models whose training measured repeatability."""
    name, model = models[0]
    repeats = {"at_once": 0.3, "drift": 0.05, "cameras": 0.04, "clocks": 0.02, "share": 0.6}
    result = evaluate_models(
        [(name, replace(model, metadata={"repeatability": repeats})), models[1]], unseen
    )
    assert result.models[1].predicted is None
    write_evaluation(tmp_path / "out", result)
    table = rows(tmp_path / "out", "predicted.csv")
    assert {r["model"] for r in table} == {name}
    squares = {r["cause"]: float(r["mean_square_mm2"]) for r in table}
    measured = squares.pop("measured")
    assert squares.pop("predicted") == pytest.approx(sum(squares.values()), rel=1e-5)
    assert measured == pytest.approx(result.models[0].evaluation.total.rmse ** 2, rel=1e-5)
    data = json.loads((tmp_path / "out" / "evaluation.json").read_text(encoding="utf-8"))
    assert data["models"][name]["predicted"]["rmse"] == pytest.approx(0.39**0.5)
    assert data["models"]["with-memory"]["predicted"] is None
    page = (tmp_path / "out" / "evaluation.html").read_text(encoding="utf-8")
    assert "Predicted against measured" in page


def test_other_devices_and_moved_markers_are_refused(models, unseen):
    with raises(TrainingError, "devices-differ", devices=("bar", "other")):
        evaluate_models(models[:1], replace(unseen, device="other"))
    with raises(TrainingError, "markers-moved"):
        evaluate_models(models[:1], replace(unseen, rest_points=unseen.rest_points + 10))


def test_files_of_the_user_are_kept(models, unseen, tmp_path):
    result = evaluate_models(models[:1], unseen)
    write_evaluation(tmp_path / "out", result)
    (tmp_path / "out" / "my-notes.txt").write_text("mine")
    with raises(TrainingError, "not-an-evaluation", file="my-notes.txt"):
        write_evaluation(tmp_path / "out", result)
    assert (tmp_path / "out" / "my-notes.txt").exists()


def test_a_single_frame(models, tmp_path):
    """One frame is evaluated, but not compared."""
    run = bar.recording(10, seed=2)
    one = replace(run, time=run.time[:1], points=run.points[:1], sigma=run.sigma[:1])
    result = evaluate_models(models, bar.dataset(one))
    assert result.comparison.tests == ()
    assert any(note.startswith("1 frames") for note in result.notes)
    write_evaluation(tmp_path / "out", result)


def test_short_names_of_models(tmp_path):
    assert short_names([tmp_path / "a" / "model.json", tmp_path / "b.json"]) == ["a", "b"]
    same = [tmp_path / "a" / "x.json", tmp_path / "b" / "x.json"]
    assert short_names(same) == [str(p) for p in same]
