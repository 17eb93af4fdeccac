"""`defsense evaluate` from files: a model that was trained, and datasets."""

import json
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.files.formats import write_tracks
from defsense_fab.cli.main import main
from defsense_fab.core.markers import Tracks
from defsense_fab.report.evaluation import evaluation_report
from defsense_fab.training.fitting.train_model import TrainingOptions, train
from defsense_fab.training.models.model_file import write_model
from defsense_fab.training.models.train_device import train_dataset
from defsense_fab.training.recordings.dataset_parquet import write_dataset
from tests.training import soft_bar as bar
from tests.training.recordings.files_of_others import write_csv


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The sessions it was trained on and another, an affine model of the first and a better one."""
    folder = tmp_path_factory.mktemp("device")
    causes = {"noise": 0.002, "sigma": 0.15, "gaps": 0.1}
    trained = bar.dataset(bar.recording(40, **causes))
    write_dataset(folder / "first", trained)
    other = replace(bar.recording(40, seed=2, **causes), session="session-2")
    write_dataset(folder / "second", bar.dataset(other))
    for name in ("affine", "quadratic"):
        (folder / name).mkdir()
        model = train_dataset(trained, TrainingOptions(name, memory=False)).model
        write_model(folder / name / "model.json", model)
    return folder


@pytest.fixture
def no_figures(monkeypatch):
    """They take seconds, and have tests of their own."""
    monkeypatch.setattr(evaluation_report, "svg_figures", lambda _: {})


def test_the_table(files, tmp_path, capsys, no_figures, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    out = tmp_path / "out"
    arguments = ["evaluate", files / "affine" / "model.json", files / "second", "--out", out]
    assert main([str(a) for a in [*arguments, "--against", files / "quadratic"]]) == 0
    shown = capsys.readouterr().out
    data = json.loads((out / "evaluation.json").read_text(encoding="utf-8"))
    for name in ("affine", "quadratic"):
        e = data["models"][name]["errors"]
        assert f"{e['rmse']:.2f} ± {e['deviation']:.2f}" in shown
    assert data["models"]["affine"]["errors"]["frames"] > 1000
    assert "4.46 ± 1.76" in shown
    assert "squared error by cause: " in shown
    assert "quadratic" in data["comparison"]["names"]
    assert f"Look at: {out / 'evaluation.html'}" in shown
    assert (out / "evaluation.html").exists()


def test_json_of_what_training_held_out(files, capsys, no_figures):
    """Beside the model where no folder is given; the same test as training's own."""
    assert main(["evaluate", str(files / "affine"), str(files / "first"), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["folder"] == str(files / "affine" / "evaluation")
    assert data["last_share"] == pytest.approx(0.3, abs=0.01)
    training = train(
        bar.dataset(bar.recording(40, noise=0.002, sigma=0.15, gaps=0.1)),
        TrainingOptions("affine", memory=False),
    )
    [own] = [a for a in training.candidates if a.name == training.selected]
    errors = data["models"]["affine"]["errors"]
    assert errors["frames"] == len(training.test_frames)
    assert errors["peak"] == pytest.approx(own.test.peak, rel=1e-6)
    assert errors["average_peak"] == pytest.approx(own.test.average_peak, rel=1e-6)


def test_files_of_others(files, tmp_path, capsys, no_figures):
    """Signals and tracks of which no file says which device they are of; late by what is mended."""
    r = bar.recording(40, seed=2, noise=0.002, sigma=0.15, gaps=0.1)
    columns = np.column_stack([r.sample_time + 0.5, r.signals])
    signals = write_csv(tmp_path / "signals.csv", ["time", *bar.CHANNELS], columns)
    tracks = Tracks(r.time, bar.IDS, r.points, r.sigma, np.arange(len(r.time)))
    write_tracks(tmp_path / "take.c3d", tracks)
    given = ["--signals", str(signals), "--tracks", str(tmp_path / "take.c3d")]
    out = ["--out", str(tmp_path / "out"), "--json"]

    def error(*words):
        assert main(["evaluate", str(files / "quadratic"), *words, *out]) == 0
        data = json.loads(capsys.readouterr().out)
        return data["models"]["quadratic"]["errors"]["rmse"], data["notes"]

    whole, _ = error(str(files / "second"))
    late, _ = error(*given)
    mended, notes = error(*given, "--shift", "auto")
    offset, _ = error(*given, "--offset", "-0.5")
    assert late > 3 * whole
    assert offset == pytest.approx(whole, rel=0.2)
    assert mended == pytest.approx(whole, rel=0.2)
    assert any("signals are shifted by -0." in note for note in notes)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["affine"], "nothing to test on: give sessions, or --signals with --tracks"),
        (["affine", "--tracks", "take.c3d"], "--signals and --tracks go together"),
        (["affine", "nowhere"], "nowhere: there is no such file or folder"),
        (["nowhere.json", "first"], "nowhere.json: cannot be read"),
        (["affine", "first", "--last-share", "1.5"], "--last-share 1.5: give a share above 0"),
        (["affine", "first", "--last-share", "nan"], "--last-share nan: give a share above 0"),
        (["affine", "second", "--against", "affine"], "give each model once"),
        (["affine", "second", "--out", "second"], "frames.parquet"),
    ],
)
def test_refusals(files, capsys, monkeypatch, no_figures, arguments, message):
    monkeypatch.chdir(files)
    assert main(["evaluate", *arguments]) == 2
    [error] = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert message in error
