"""From two tables to a model, a page and a live run, as typed."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import defsense_fab as df
from defsense_fab.cli.main import main, run_command
from defsense_fab.core.errors import DefsenseError
from defsense_fab.training.fitting.model_file import load_model
from tests.support.errors import raises
from tests.training.recordings.tables import write_pair


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tables of two runs, and a model that was trained on them."""
    folder = tmp_path_factory.mktemp("sensor")
    for k in range(2):
        write_pair(folder, f"run{k}", seed=k, seconds=40)
    words = [*words_of(folder), "--no-memory", "--out", str(folder / "model.json")]
    assert main(["train", *words]) == 0
    return folder


def words_of(folder: Path) -> list[str]:
    signals, targets = (
        [str(folder / f"run{k}{end}.csv") for k in range(2)] for end in ("", "-truth")
    )
    return ["--signals", *signals, "--targets", *targets]


@pytest.mark.slow
def test_train_and_evaluate_print_the_same_errors(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = words_of(folder)
    model = str(tmp_path / "m.json")
    options = ("--no-memory", "--leave-out", "run1", "--out", model, "--json")
    assert main(["train", *words, *options]) == 0
    trained = json.loads(capsys.readouterr().out)
    assert trained["test"]["unit"] == "deg"
    assert trained["test"]["rmse"] == trained["test"]["by_unit"]["deg"]["rmse"] < 0.5
    assert 0.5 < trained["test"]["coverage"] <= 1
    out = tmp_path / "page"
    assert main(["evaluate", model, *words, "--out", str(out), "--json"]) == 0
    evaluated = json.loads(capsys.readouterr().out)
    for unit in ("deg", "N"):
        mine, other = (d["test"]["by_unit"][unit] for d in (evaluated, trained))
        assert mine["rmse"] == pytest.approx(other["rmse"], rel=1e-9)
        assert mine["coverage"] == pytest.approx(other["coverage"])
    assert evaluated["paper"] == {}
    page = (out / "evaluation.html").read_text(encoding="utf-8")
    assert "CHI 2016" not in page
    assert "angle" in page
    assert (out / "values.svg").exists()
    assert (out / "values-N.svg").exists()
    with (out / "values.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["unit"] for row in rows} == {"deg", "N"}
    errors = [float(r["measured"]) - float(r["predicted"]) for r in rows if r["target"] == "angle"]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(trained["test"]["rmse"], rel=1e-3)


def test_a_replayed_table_is_decoded_as_by_the_model(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (folder / "run0.csv").read_text(encoding="utf-8").splitlines()
    rows = lines[:60]
    rows[20] = rows[20].partition(",")[0] + ",,"  # a sample without any value
    (tmp_path / "live.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    words = ["--port", f"replay:{tmp_path / 'live.csv'}", "--record", str(tmp_path / "run")]
    assert main(["run", str(folder / "model.json"), *words, "--json"]) == 0
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert last["targets"]["angle"]["unit"] == "deg"
    table = np.genfromtxt(
        tmp_path / "run" / "targets.csv", delimiter=",", names=True, usecols=range(5)
    )
    assert table.dtype.names[:3] == ("time", "angle_deg", "force_N")
    model = load_model(folder / "model.json")
    values = np.genfromtxt(tmp_path / "live.csv", delimiter=",", skip_header=1)
    signals = model.readings.signals(values[:, 1:])
    expected = model.decode(values[:, 0], signals, values[:, 0]).points[..., 0]
    is_known = np.isfinite(expected).all(axis=1)
    at = np.searchsorted(values[:, 0], table["time"] - 1e-6)
    known = is_known[at]
    assert known.sum() > 50
    angle = table["angle_deg"]
    np.testing.assert_allclose(angle[known], expected[at][known, 0], rtol=1e-4, atol=1e-4)
    assert np.isfinite(angle).all()  # the last value is repeated


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("--view",), "no-surface"),
        (("--animation", "a.glb"), "no-surface"),
        (("--output", "midi"), "no-surface"),
        (("--rest", "1000"), "no-surface"),
    ],
)
def test_outputs_of_surfaces_and_poses_are_refused(
    folder: Path, words: tuple[str, ...], code: str
) -> None:
    port = f"replay:{folder / 'run0.csv'}"
    with raises(DefsenseError, code):
        run_command(["run", str(folder / "model.json"), "--port", port, *words])


def test_files_without_a_partner_are_refused(folder: Path) -> None:
    signals, targets = str(folder / "run0.csv"), str(folder / "run0-truth.csv")
    with raises(DefsenseError, "file-not-found", missing="signals"):
        run_command(["train", "--signals", signals, "--targets", targets, targets])
    with raises(DefsenseError, "options-conflict", option="targets"):
        run_command(["train", "--signals", signals, "--targets", targets, "--tracks", targets])


def test_the_python_interface_gives_the_same_model(folder: Path) -> None:
    runs = [df.read_tables(folder / f"run{k}.csv", folder / f"run{k}-truth.csv") for k in range(2)]
    data = df.join(*runs)
    model = df.train(data, memory=False)
    expected = load_model(folder / "model.json")
    np.testing.assert_allclose(
        model.record.main.decoder.weights, expected.main.decoder.weights, rtol=1e-9
    )
    assert model.target_names == ("angle", "force")
    assert model.units == ("deg", "N")
    r = data.recordings[0]
    values = model.predict(r.sample_time, r.ohm)
    assert values.shape == (len(r.sample_time), 2, 1)
    with raises(DefsenseError, "options-conflict"):
        model.predict(r.sample_time, r.ohm, r.rest)
    twice = df.join(runs[0], runs[0])
    assert [r.name for r in twice.recordings] == ["run0", "run0-2"]
