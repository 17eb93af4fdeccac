"""Pairing over USB: the host's commands, and the program under CPython."""

import json
import tomllib

import numpy as np
import pytest

from defsense_fab.capture.boards.wifi_setup import WifiSetup
from defsense_fab.capture.readout.paired_boards import find_board, store_board
from defsense_fab.capture.readout.ports import open_port
from defsense_fab.capture.readout.reader import Reader
from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import CaptureError
from defsense_fab.sensing.packets import OPEN_KEY
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.workflow.board.options import PairOptions
from defsense_fab.workflow.board.pair import pair_board
from tests.firmware.micropython.test_loopback import collect
from tests.support.errors import raises

BOARD_ID = "a4cf12345678"
PASSWORD = "two words & a ü"
NETWORK = "the lab/2"


def test_paired_board_is_read_by_its_name(start_board, settings, tmp_path):
    board = start_board({})
    result = pair_board(NETWORK, PASSWORD, PairOptions(port=board.serial, name="elbow"))
    assert (result.board_id, result.address, result.port) == (BOARD_ID, "127.0.0.1", "udp://elbow")
    stored = json.loads(settings.read_text())
    assert (stored["name"], stored["password"]) == (NETWORK, PASSWORD)
    # The password stays on the board, and only the owner reads the key.
    path = tmp_path / "config" / "boards.toml"
    assert PASSWORD not in path.read_text("utf-8")
    assert path.stat().st_mode & 0o077 == 0
    known = find_board("elbow")
    assert stored["key"] == known.key.hex() != OPEN_KEY.hex()
    assert tomllib.loads(path.read_text("utf-8"))
    # Boards of tests listen on any free port.
    store_board(BOARD_ID, "elbow", known.key, f"127.0.0.1:{board.udp}")
    with Reader(lambda: open_port("udp://elbow"), "udp://elbow") as reader:
        collect(reader, 3)


def test_pairing_again_makes_another_key_and_keeps_the_name(start_board):
    board = start_board({})
    pair_board(NETWORK, "", PairOptions(port=board.serial, name="elbow"))
    first = find_board("elbow").key
    assert pair_board(NETWORK, "", PairOptions(port=board.serial)).name == "elbow"
    assert find_board(BOARD_ID).key != first


@pytest.mark.parametrize(
    ("network", "password", "timeout", "code"),
    [
        ("lab", "wrong-password", 30, "wifi-password-wrong"),
        ("missing", "", 30, "wifi-network-not-found"),
        ("slow", "", 1, "wifi-join-timeout"),
    ],
)
def test_board_that_does_not_join_is_not_paired(start_board, network, password, timeout, code):
    board = start_board({})
    with raises(CaptureError, code):
        pair_board(network, password, PairOptions(port=board.serial, timeout=timeout))
    assert find_board(BOARD_ID) is None


def test_bad_names_are_refused_before_anything_is_stored(start_board, settings):
    board = start_board({})
    store_board("111111111111", "elbow", bytes(range(16)), "")
    with raises(CaptureError, "board-name-taken", board="111111111111"):
        pair_board(NETWORK, PASSWORD, PairOptions(port=board.serial, name="elbow"))
    with raises(CaptureError, "board-name-invalid"):
        pair_board(NETWORK, PASSWORD, PairOptions(port=board.serial, name="my elbow"))
    assert json.loads(settings.read_text()) == {}


def test_network_is_no_port_for_pairing():
    with raises(CaptureError, "port-not-serial"):
        pair_board(NETWORK, "", PairOptions(port="udp://elbow"))


def test_board_without_wifi_is_reported():
    class Cords:
        channels = ("a", "b", "c")

        def sample(self, start, step):
            return np.full(3, 2000.0)

    with raises(CaptureError, "board-without-wifi"):
        WifiSetup(ReadoutTwin(Cords()), "port")


def test_command_pairs_without_a_key_on_request(start_board, settings, monkeypatch, capsys):
    board = start_board({})
    monkeypatch.setenv("DEFSENSE_WIFI_PASSWORD", PASSWORD)
    words = ["board", "pair", "--port", board.serial, "--network", NETWORK]
    run_command([*words, "--no-key", "--json"])
    assert json.loads(capsys.readouterr().out)["port"] == "udp://127.0.0.1?key=none"
    assert json.loads(settings.read_text())["key"] == OPEN_KEY.hex()
    assert find_board(BOARD_ID) is None
    run_command(words)
    text = capsys.readouterr().out
    assert f"udp://{find_board(BOARD_ID).name}" in text
    assert PASSWORD not in text


def test_password_is_not_asked_without_a_terminal(monkeypatch):
    monkeypatch.delenv("DEFSENSE_WIFI_PASSWORD", raising=False)
    with raises(CaptureError, "wifi-credentials-missing"):
        run_command(["board", "pair", "--port", "/dev/null", "--network", "lab"])


def test_command_writes_the_program(tmp_path, capsys):
    out = tmp_path / "program"
    run_command(["board", "micropython", str(out), "--converter", "internal", "--json"])
    files = json.loads(capsys.readouterr().out)["files"]
    assert {"main.py", "config.py", "frames.py"} <= {p.name for p in out.iterdir()}
    assert len(files) == len(list(out.iterdir()))
    assert 'CONVERTER = "internal"' in (out / "config.py").read_text("utf-8")
