"""`defsense dataset` on the command line."""

import json

import numpy as np
import pytest

from defsense_fab.cli.main import main, run_command
from defsense_fab.core.errors import DefsenseError
from defsense_fab.training.recordings.dataset_parquet import read_dataset, write_dataset
from tests.support.errors import raises
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
    printed = capsys.readouterr().out
    for count in ("810", "5 markers", "1620", "3 channels"):
        assert count in printed
    assert "note: " in printed
    assert f"Next:    defsense train '{out}'" in printed
    again, before = read_dataset(out), read_dataset(folder / "data")
    np.testing.assert_array_equal(again.recordings[1].ohm, before.recordings[1].ohm)
    assert again.provenance["sha256"] == before.provenance["sha256"]
    info = json.loads((robot / "meta" / "info.json").read_text(encoding="utf-8"))
    assert (info["fps"], info["total_episodes"]) == (15, 2)


def test_json_lists_problems_and_the_dataset_is_written(tmp_path, capsys):
    late = dataset(recording(1, 40.0, late=0.5))
    write_dataset(tmp_path / "late", late)
    words = ["dataset", str(tmp_path / "late"), "--out", str(tmp_path / "out"), "--json"]
    assert main(words) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["channels"] == list(CHANNELS)
    assert data["recordings"][0]["frames"] == 1200
    assert {"out of step": False}.items() <= {
        p["kind"]: p["fatal"] for p in data["problems"]
    }.items()
    assert main([*words, "--shift", "auto"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert not any(p["fatal"] for p in data["problems"])
    shift = read_dataset(tmp_path / "out").provenance["shifts"]["session-1/run-1"]
    assert shift == pytest.approx(-0.5, abs=0.1)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--out", "new"], "sources-missing"),
        (["data"], "output-missing"),
        (["data", "--out", "new", "--rate", "15"], "options-conflict"),
        (["data", "--lerobot", "new", "--rate", "0"], "out-of-range"),
        (["data", "--lerobot", "data"], "file-exists"),
        (["data", "--out", "."], "not-a-dataset"),
        (["none", "--out", "new"], "file-not-found"),
    ],
)
def test_invalid_options_change_nothing(folder, monkeypatch, words, code):
    monkeypatch.chdir(folder)
    with raises(DefsenseError, code):
        run_command(["dataset", *words])
    assert [p.name for p in folder.iterdir()] == ["data"]
