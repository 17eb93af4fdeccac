"""`defsense evaluate` with trained models and datasets."""

import json
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.files.formats import write_tracks
from defsense_fab.cli.main import main, run_command
from defsense_fab.core.errors import DefsenseError
from defsense_fab.core.markers import Tracks
from defsense_fab.report.evaluation import evaluation_report
from defsense_fab.training.fitting.model_file import write_model
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.recordings.dataset_parquet import write_dataset
from defsense_fab.workflow.train.training import train_dataset
from tests.support.errors import raises
from tests.training import soft_bar as bar
from tests.training.recordings.files_of_others import write_csv


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The training session, another session, an affine model and a better one."""
    folder = tmp_path_factory.mktemp("device")
    causes = {"noise": 0.002, "sigma": 0.15, "gaps": 0.1}
    trained = bar.dataset(bar.recording(40, **causes))
    write_dataset(folder / "first", trained)
    other = replace(bar.recording(40, seed=2, **causes), session="session-2")
    write_dataset(folder / "second", bar.dataset(other))
    for name in ("affine", "quadratic"):
        (folder / name).mkdir()
        model = train_dataset(trained, TrainOptions(name, memory=False)).model
        write_model(folder / name / "model.json", model)
    return folder


@pytest.fixture
def no_figures(monkeypatch):
    """Skip the figures, which take seconds and are tested elsewhere."""
    monkeypatch.setattr(evaluation_report, "svg_figures", lambda _: {})


def test_table_and_files(files, tmp_path, capsys, no_figures, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    out = tmp_path / "out"
    arguments = ["evaluate", files / "affine" / "model.json", files / "second", "--out", out]
    assert main([str(a) for a in [*arguments, "--against", files / "quadratic"]]) == 0
    printed = capsys.readouterr().out
    data = json.loads((out / "evaluation.json").read_text(encoding="utf-8"))
    for name in ("affine", "quadratic"):
        e = data["models"][name]["errors"]
        assert f"{e['rmse']:.2f} ± {e['deviation']:.2f}" in printed
        share = 100 * e["rmse"] / data["models"][name]["usefulness"]["travel"]
        assert f"{share:.2g} %" in data["models"][name]["usefulness"]["grade"]
    grade = data["models"]["affine"]["usefulness"]["grade"]
    assert grade in " ".join(printed.split())
    assert grade in (out / "evaluation.html").read_text("utf-8")
    assert data["models"]["affine"]["errors"]["frames"] > 1000
    assert "4.46 ± 1.76" in printed
    assert "quadratic" in data["comparison"]["names"]
    assert f"Look at: {out / 'evaluation.html'}" in printed
    assert (out / "evaluation.html").exists()


@pytest.mark.slow
def test_a_useless_model_is_reported_first(files, tmp_path, capsys, no_figures):
    causes = {"noise": 0.002, "sigma": 0.15, "gaps": 0.1}
    r = replace(bar.recording(40, seed=2, **causes), session="session-2")
    order = [1, 2, 0]
    r = replace(r, ohm=r.ohm[:, order], rest=r.rest[order])
    write_dataset(tmp_path / "exchanged", bar.dataset(r))
    words = ["evaluate", files / "affine", tmp_path / "exchanged", "--out", tmp_path / "out"]
    assert main([*map(str, words)]) == 0
    assert capsys.readouterr().out.startswith("warning: affine: ")
    assert main([*map(str, words), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)["models"]["affine"]
    assert data["usefulness"]["code"] == "useless-model"
    assert data["usefulness"]["cause"]["code"] == "permuted-channels"
    assert data["usefulness"]["message"] in (tmp_path / "out" / "evaluation.html").read_text(
        "utf-8"
    )
    assert main(["evaluate", str(files / "affine"), str(files / "second"), "--json"]) == 0
    useful = json.loads(capsys.readouterr().out)["models"]["affine"]["usefulness"]
    assert useful["code"] is None
    assert useful["error"] < 0.5 * useful["movement"]


def test_default_test_data_are_those_of_training(files, capsys, no_figures):
    """Without options, the folder is next to the model, and the test is that of the training."""
    assert main(["evaluate", str(files / "affine"), str(files / "first"), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["folder"] == str(files / "affine" / "evaluation")
    assert data["last_share"] == pytest.approx(0.3, abs=0.01)
    training = train(
        bar.dataset(bar.recording(40, noise=0.002, sigma=0.15, gaps=0.1)),
        TrainOptions("affine", memory=False),
    )
    [own] = [a for a in training.candidates if a.name == training.selected]
    errors = data["models"]["affine"]["errors"]
    assert errors["frames"] == len(training.test_frames)
    assert errors["peak"] == pytest.approx(own.test.peak, rel=1e-6)
    assert errors["average_peak"] == pytest.approx(own.test.average_peak, rel=1e-6)


@pytest.mark.slow
def test_signals_and_tracks_files(files, tmp_path, capsys, no_figures):
    """Late signals without a device are corrected with --shift or --offset."""
    r = bar.recording(40, seed=2, noise=0.002, sigma=0.15, gaps=0.1)
    columns = np.column_stack([r.sample_time + 0.5, r.signals])
    signals = write_csv(tmp_path / "signals.csv", ["time", *bar.CHANNELS], columns)
    tracks = Tracks(r.time, bar.IDS, r.points, r.sigma, np.arange(len(r.time)))
    write_tracks(tmp_path / "take.c3d", tracks)
    words_of_files = ["--signals", str(signals), "--tracks", str(tmp_path / "take.c3d")]
    out = ["--out", str(tmp_path / "out"), "--json"]

    def error(*words):
        assert main(["evaluate", str(files / "quadratic"), *words, *out]) == 0
        data = json.loads(capsys.readouterr().out)
        return data["models"]["quadratic"]["errors"]["rmse"], data["notes"]

    whole, _ = error(str(files / "second"))
    late, _ = error(*words_of_files)
    corrected, notes = error(*words_of_files, "--shift", "auto")
    offset, _ = error(*words_of_files, "--offset", "-0.5")
    assert late > 3 * whole
    assert offset == pytest.approx(whole, rel=0.2)
    assert corrected == pytest.approx(whole, rel=0.2)
    assert any("-0." in note for note in notes)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["affine"], "sources-missing"),
        (["affine", "--tracks", "take.c3d"], "file-not-found"),
        (["affine", "nowhere"], "file-not-found"),
        (["nowhere.json", "first"], "file-not-found"),
        (["affine", "first", "--last-share", "1.5"], "out-of-range"),
        (["affine", "first", "--last-share", "nan"], "out-of-range"),
        (["affine", "second", "--against", "affine"], "name-repeated"),
        (["affine", "second", "--out", "second"], "not-an-evaluation"),
    ],
)
def test_invalid_options(files, monkeypatch, no_figures, words, code):
    monkeypatch.chdir(files)
    with raises(DefsenseError, code):
        run_command(["evaluate", *words])
