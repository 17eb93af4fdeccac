"""How the studio starts."""

from __future__ import annotations

import socket

import pytest

from defsense_fab.cli.main import main
from tests.studio.devices import TEXT, write_device

pytest.importorskip("viser")


@pytest.fixture
def start(capsys, monkeypatch, tmp_path):
    """Exit code and output of a short studio."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "settings"))

    def run(folder, *more):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        given = ["studio", str(folder), "--port", str(port), "--no-browser", "--seconds", "0.1"]
        code = main([*given, *more])
        out = capsys.readouterr()
        return code, out.out.replace(str(port), "PORT"), out.err

    return run


def test_a_folder_without_device_begins_and_nothing_is_written(start, tmp_path):
    code, out, _ = start(tmp_path / "new")
    assert code == 0
    assert "http://127.0.0.1:PORT\n" in out
    assert not (tmp_path / "new").exists()


def test_a_device_that_cannot_be_read_does_not_end_it(start, tmp_path):
    folder = write_device(tmp_path / "grip")
    (folder / "device.toml").write_text(TEXT.replace("schema = 1", "schema ="))
    assert start(folder)[0] == 0


def test_other_machines_get_a_link_with_a_token(start, tmp_path):
    code, out, _ = start(tmp_path / "new", "--host", "0.0.0.0", "--trust")
    assert code == 0
    assert ":PORT/?token=" in out
    assert "the link is the key" in out


def test_what_cannot_start_is_told(start, tmp_path):
    code, _, err = start(tmp_path / "new", "--host", "192.0.2.1")
    assert code == 2
    assert "no such address" in err
    (tmp_path / "file").touch()
    code, _, err = start(tmp_path / "file")
    assert code == 2
    assert "is no folder" in err
