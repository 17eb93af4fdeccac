"""`defsense dataset` as a user runs it."""

import json

import numpy as np
import pytest

from defsense_fab.cli.main import main
from defsense_fab.training.recordings.dataset_parquet import read_dataset, write_dataset
from tests.training.synthetic import CHANNELS, dataset, recording


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a dataset `data` of two recordings."""
    folder = tmp_path_factory.mktemp("files")
    write_dataset(folder / "data", dataset(recording(1, 15.0), recording(2, 12.0)))
    return folder


def test_both_formats(folder, tmp_path, capsys):
    out, robot = tmp_path / "a b", tmp_path / "robot"
    words = ["dataset", str(folder / "data"), "--out", str(out), "--lerobot", str(robot)]
    assert main([*words, "--rate", "15"]) == 0
    shown = capsys.readouterr().out
    assert "bar: 810 pictures of 5 markers and 1620 samples of 3 channels" in shown
    assert "note: frames with markers and all signals last 2" in shown
    assert f"Next:    defsense train '{out}'" in shown
    again, before = read_dataset(out), read_dataset(folder / "data")
    np.testing.assert_array_equal(again.recordings[1].ohm, before.recordings[1].ohm)
    assert again.provenance["sha256"] == before.provenance["sha256"]
    info = json.loads((robot / "meta" / "info.json").read_text(encoding="utf-8"))
    assert (info["fps"], info["total_episodes"]) == (15, 2)


def test_json_tells_what_forbids_training_and_writes_it_all_the_same(tmp_path, capsys):
    late = dataset(recording(1, 40.0, late=0.5))
    write_dataset(tmp_path / "late", late)
    words = ["dataset", str(tmp_path / "late"), "--out", str(tmp_path / "out"), "--json"]
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["channels"] == list(CHANNELS)
    assert told["recordings"][0]["frames"] == 1200
    first = told["problems"][0]
    assert (first["kind"], first["fatal"]) == ("out of step", True)
    assert main([*words, "--shift", "auto"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert not any(p["fatal"] for p in told["problems"])
    shift = read_dataset(tmp_path / "out").provenance["shifts"]["session-1/run-1"]
    assert shift == pytest.approx(-0.5, abs=0.1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--out", "new"], "nothing to write: give sessions, or --signals with --tracks"),
        (["data"], "nowhere to write: give --out FOLDER, --lerobot FOLDER, or both"),
        (["data", "--out", "new", "--rate", "15"], "--rate is of --lerobot alone"),
        (["data", "--lerobot", "new", "--rate", "0"], "--rate 0: give a number from 1 to 1000"),
        (["data", "--lerobot", "data"], "data: is there already; name a folder that is not"),
        (["data", "--out", "."], "holds data, is no dataset and would be overwritten"),
        (["none", "--out", "new"], "none: there is no such file or folder"),
    ],
)
def test_refusals(folder, capsys, monkeypatch, words, message):
    monkeypatch.chdir(folder)
    assert main(["dataset", *words]) == 2
    [error] = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert message in error
    assert [p.name for p in folder.iterdir()] == ["data"]
