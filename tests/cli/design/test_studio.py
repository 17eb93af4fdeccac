"""`defsense studio`: how the studio starts."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from defsense_fab.cli.main import main, run_command
from defsense_fab.core.errors import OutputError, StorageError
from defsense_fab.studio.app import studio_app
from defsense_fab.studio.app.studio_app import StudioApp
from tests.studio.devices import TEXT, write_device
from tests.support.errors import raises


@pytest.fixture
def start(capsys, monkeypatch, tmp_path):
    """Exit code and output of a short studio."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "settings"))

    def run(*more):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        words = ["studio", "--port", str(port), "--no-browser", "--seconds", "0.1"]
        code = main([*words, *map(str, more)])
        out = capsys.readouterr()
        return code, out.out.replace(str(port), "PORT"), out.err

    return run


def test_without_a_folder_the_current_device_or_a_new_one_is_opened(start, tmp_path, monkeypatch):
    opened = []

    class Recorder(StudioApp):
        def __init__(self, server, folder, agreement):
            opened.append(folder)
            super().__init__(server, folder, agreement)

    monkeypatch.setattr(studio_app, "StudioApp", Recorder)
    (tmp_path / "new-device").mkdir()
    for folder in (write_device(tmp_path / "grip"), tmp_path):
        monkeypatch.chdir(folder)
        assert start()[0] == 0
    assert opened == [Path(), Path("new-device-2")]
    assert not Path("new-device-2").exists()


def test_folder_without_device_stays_unwritten(start, tmp_path):
    code, out, _ = start(tmp_path / "new")
    assert code == 0
    assert "http://127.0.0.1:PORT/\n" in out
    assert not (tmp_path / "new").exists()


def test_invalid_device_does_not_stop_the_studio(start, tmp_path):
    folder = write_device(tmp_path / "grip")
    (folder / "device.toml").write_text(TEXT.replace("schema = 1", "schema ="))
    assert start(folder)[0] == 0


def test_link_for_other_machines_contains_a_token(start, tmp_path):
    code, out, _ = start(tmp_path / "new", "--host", "0.0.0.0", "--trust")
    assert code == 0
    assert ":PORT/?token=" in out


def test_studio_that_cannot_start(tmp_path):
    short = ["--no-browser", "--seconds", "0.1"]
    with raises(OutputError, "address-unavailable", host="192.0.2.1"):
        run_command(["studio", str(tmp_path / "new"), "--host", "192.0.2.1", *short])
    (tmp_path / "file").touch()
    with raises(StorageError, "not-a-folder"):
        run_command(["studio", str(tmp_path / "file"), *short])
