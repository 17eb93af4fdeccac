"""`defsense train` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from sklearn.linear_model import Ridge

from defsense_fab.capture.files.formats import write_tracks
from defsense_fab.cli.main import main, run_command
from defsense_fab.core.arrays import Float
from defsense_fab.core.errors import DefsenseError
from defsense_fab.core.markers import Tracks
from defsense_fab.training.fitting.model_file import load_model
from tests.support.errors import raises
from tests.training import synthetic

NAMES = ("left", "top", "right")


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path, Float, Float]:
    """signals.csv and tracks.csv of half a minute, and their numbers."""
    rng = np.random.default_rng(0)
    time = np.arange(90, 990) / 30  # three seconds of rest first
    still = time < 6
    levels = np.stack([np.sin(w * time) for w in (1.1, 1.7, 2.3)], axis=1)
    levels[still] = 0
    signals = np.round(0.1 * levels + 0.002 * rng.normal(size=levels.shape), 6)
    moves = 10 * rng.normal(size=(3, 15))
    points = (levels @ moves).reshape(-1, 5, 3) + rng.uniform(-40, 40, (5, 3))
    points = np.round(points + 0.1 * rng.normal(size=points.shape), 6)
    lines = ["frame,time," + ",".join(NAMES) + ",alignment_residual"]
    lines += [
        f"{k},{t:.6f}," + ",".join(f"{x:.6f}" for x in s) + ",0.05"
        for k, (t, s) in enumerate(zip(time, signals, strict=True))
    ]
    (tmp_path / "signals.csv").write_text("\n".join(lines) + "\n")
    tracks = Tracks(time, np.arange(5), points, np.full(points.shape, 0.1), np.arange(len(time)))
    write_tracks(tmp_path / "tracks.csv", tracks)
    return tmp_path / "signals.csv", tmp_path / "tracks.csv", signals, points


def run(*words: object) -> int:
    return main([str(w) for w in words])


def test_affine_model_of_two_files_equals_scikit_learn_ridge(
    pair: tuple[Path, Path, Float, Float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    signals, tracks, s, points = pair
    model = tmp_path / "model.json"
    assert (
        run(
            "train",
            "--signals",
            signals,
            "--tracks",
            tracks,
            "--decoder",
            "affine",
            "--no-memory",
            "--out",
            model,
            "--json",
        )
        == 0
    )
    data = json.loads(capsys.readouterr().out)
    row = data["candidates"][0]
    assert data["decoder"] == row["decoder"] == "affine"
    assert len(row["folds"]) == 5
    assert data["pictures"] == {"trained": 630, "tested": 270}
    peer = Ridge(alpha=row["lambda"] ** 2, solver="cholesky", tol=1e-12)
    peer.fit(s[:630], points[:630].reshape(630, -1))
    residual = peer.predict(s[630:]).reshape(-1, 5, 3) - points[630:]
    assert row["test"]["rmse"] == pytest.approx(np.sqrt((residual**2).sum(2).mean()), rel=1e-9)
    assert row["test"]["peak"] == pytest.approx(np.linalg.norm(residual, axis=2).max(), rel=1e-6)
    decoder = load_model(model).main.decoder
    np.testing.assert_allclose(decoder.weights, peer.coef_.T, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_table_contains_the_affine_decoder_and_the_next_command(
    pair: tuple[Path, Path, Float, Float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    signals, tracks, _, _ = pair
    assert run("train", "--signals", signals, "--tracks", tracks, "--out", tmp_path) == 0
    out = capsys.readouterr().out
    assert "affine" in out
    command = f"defsense evaluate {tmp_path / 'model.json'} --signals {signals} --tracks {tracks}"
    assert f"Next:    {command}" in out


def test_a_useless_model_is_written_and_reported_first(
    pair: tuple[Path, Path, Float, Float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    signals, tracks, _, _ = pair
    rows = [row.split(",") for row in signals.read_text(encoding="utf-8").splitlines()]
    for row in rows[631:]:  # the cords are plugged in otherwise in the test
        row[2:5] = [row[3], row[4], row[2]]
    signals.write_text("\n".join(map(",".join, rows)) + "\n")
    options = ("--decoder", "affine", "--no-memory", "--out", tmp_path)
    words = ("train", "--signals", signals, "--tracks", tracks, *options)
    assert run(*words) == 0
    first = capsys.readouterr().out.splitlines()[0]
    metadata = load_model(tmp_path / "model.json").metadata["usefulness"]
    assert first.startswith("warning: ")
    assert metadata["message"] in first
    assert run(*words, "--json") == 0
    data = json.loads(capsys.readouterr().out)["usefulness"]
    assert data == metadata
    assert data["code"] == "useless-model"
    assert data["error"] > 0.8 * data["movement"]
    assert data["cause"]["code"] == "permuted-channels"
    assert data["cause"]["order"] == {"left": "top", "top": "right", "right": "left"}


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ((), "sources-missing"),
        (("--signals", "signals.csv"), "file-not-found"),
        (("nowhere",), "file-not-found"),
        (("--shift", "soon", "--signals", "{s}", "--tracks", "{t}"), "argument-invalid"),
        (("--offset", "nan", "--signals", "{s}", "--tracks", "{t}"), "out-of-range"),
        (("--signals", "{s}", "--tracks", "{t}", "--prior", "yes"), "device-missing"),
        (
            ("--signals", "{s}", "--tracks", "{t}", "--out", "no/folder/model.json"),
            "folder-not-found",
        ),
        (("--signals", "{s}", "--tracks", "{t}", "--out", "model.txt"), "wrong-file-format"),
        (("--signals", "{s}", "--tracks", "{t}", "--decoder", "neural"), "argument-invalid"),
    ],
)
def test_invalid_options_write_no_model(
    pair: tuple[Path, Path, Float, Float], words: tuple[str, ...], code: str
) -> None:
    signals, tracks, _, _ = pair
    with raises(DefsenseError, code):
        run_command(["train", *(word.format(s=signals, t=tracks) for word in words)])
    assert not list(signals.parent.glob("*.json"))


@pytest.mark.slow
def test_late_signals_are_detected_and_corrected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    r = synthetic.recording(1, late=0.5)
    signals, tracks = tmp_path / "signals.csv", tmp_path / "tracks.csv"
    rows = np.column_stack([r.sample_time, r.signals])
    header = ",".join(["time", *synthetic.CHANNELS])
    np.savetxt(signals, rows, delimiter=",", header=header, comments="", fmt="%.6f")
    frames = np.arange(len(r.time))
    write_tracks(tracks, Tracks(r.time, synthetic.IDS, r.points, r.sigma, frames))
    options = ("--decoder", "affine", "--no-memory", "--out", tmp_path)
    words = ("train", "--signals", signals, "--tracks", tracks, *options)
    assert run(*words) == 0
    assert "0.5" in next(k for k in capsys.readouterr().out.splitlines() if " late (" in k)
    assert run(*words, "--shift", "auto") == 0
    assert "-0.5" in capsys.readouterr().out
    assert run(*words, "--in-step") == 0
    assert " late (" not in capsys.readouterr().out
    assert load_model(tmp_path / "model.json").metadata["options"]["in_step"]
    with raises(DefsenseError, "options-conflict"):
        run_command([*map(str, words), "--in-step", "--shift", "auto"])
