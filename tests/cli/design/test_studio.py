"""`defsense studio`: how the studio starts."""

from __future__ import annotations

import socket

import pytest

from defsense_fab.cli.main import main, run_command
from defsense_fab.core.errors import OutputError, StorageError
from tests.studio.devices import TEXT, write_device
from tests.support.errors import raises


@pytest.fixture
def start(capsys, monkeypatch, tmp_path):
    """Exit code and output of a short studio."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "settings"))

    def run(folder, *more):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        words = ["studio", str(folder), "--port", str(port), "--no-browser", "--seconds", "0.1"]
        code = main([*words, *more])
        out = capsys.readouterr()
        return code, out.out.replace(str(port), "PORT"), out.err

    return run


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
