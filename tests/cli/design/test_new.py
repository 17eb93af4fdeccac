"""`defsense new`: what it asks, refuses and leaves."""

from __future__ import annotations

import io
import json

import pytest

from defsense_fab.cli.exit_codes import STOPPED
from defsense_fab.cli.main import main
from defsense_fab.core.device.device_file import load_device
from tests.places import DEVICES

BLOB = str(DEVICES / "blob" / "blob.stl")


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def typed(monkeypatch):
    def give(*lines):
        monkeypatch.setattr("sys.stdin", Terminal("".join(f"{line}\n" for line in lines)))

    return give


def test_enter_takes_the_first_device_of_the_gallery(typed, tmp_path, capsys):
    typed("", "")
    assert main(["new", str(tmp_path / "my bar")]) == 0
    device = load_device(tmp_path / "my bar")
    assert (device.name, device.cord.name) == ("my-bar", "rubber-2mm")
    assert f"defsense build '{tmp_path / 'my bar'}'" in capsys.readouterr().out


def test_a_path_may_have_commas_and_the_folder_points(typed, tmp_path, monkeypatch):
    body = tmp_path / "blob, second.stl"
    body.write_bytes((DEVICES / "blob" / "blob.stl").read_bytes())
    (tmp_path / "device" / "inner").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "device" / "inner")
    typed(str(body), "", "")
    assert main(["new", ".."]) == 0
    assert load_device(tmp_path / "device").name == "device"


def test_wrong_answers_are_told_and_asked_again(typed, tmp_path, capsys):
    typed("none.stl", BLOB, "fly", "1,3", "rope", "2")
    assert main(["new", str(tmp_path / "blob")]) == 0
    device = load_device(tmp_path / "blob")
    assert [p.name for p in device.poses] == ["bend", "twist"]
    assert device.cord.name == "rubber-1.7mm"
    assert device.propose == 3
    told = capsys.readouterr().out
    for part in ("none.stl: no such file", "poses fly: write modes", "cord rope: there is"):
        assert part in told


def test_flags_ask_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(["new", str(tmp_path / "x"), "--body", BLOB, "--poses", "bend", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["poses"], told["unit"], len(told["size_mm"])) == (["bend"], "mm", 3)
    assert load_device(tmp_path / "x").fabrication.process == told["process"]


def test_a_terminal_that_closes_leaves_nothing(typed, tmp_path, capsys):
    typed(BLOB)
    assert main(["new", str(tmp_path / "x")]) == STOPPED
    assert "stopped; nothing was written" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "--body: give one of bar"),
        (["--body", "none"], "none: is no file, and none of bar"),
        (["--body", "none.stl"], "no such file"),
        (["--body", str(DEVICES)], "is a folder"),
        (["--body", BLOB, "--units", "mile"], "units mile: there is mm"),
        (["--body", BLOB, "--units", "m"], "choose another unit"),
        (["--body", BLOB, "--units", "um"], "choose another unit"),
        (["--body", BLOB, "--units", "inch", "--cords", "0"], "--cords 0"),
        (["--body", BLOB, "--poses", "fly"], "poses fly"),
        (["--body", BLOB, "--process", "stone"], "process stone"),
        (["--body", BLOB, "--edge-length", "nan"], "edge_length"),
        (["--body", "bar", "--poses", "bend"], "comes with its own"),
        (["--body", "bar", "--cord", "rope"], "cord rope"),
    ],
)
def test_what_cannot_be_is_one_line(words, told, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(["new", str(tmp_path / "x"), *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert told in error
    assert not list(tmp_path.iterdir())


def test_a_device_that_is_there_stays(tmp_path, capsys):
    (tmp_path / "device.toml").write_text("mine", encoding="utf-8")
    assert main(["new", str(tmp_path), "--body", "bar"]) == 2
    assert "there is a device already" in capsys.readouterr().err
    assert (tmp_path / "device.toml").read_text(encoding="utf-8") == "mine"
