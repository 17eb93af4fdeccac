"""Boards that were paired with this computer, and the URLs by which they are read."""

import os

import pytest

from defsense_fab.capture.readout.paired_boards import find_board, read_boards, store_board
from defsense_fab.capture.readout.ports import open_port
from defsense_fab.core.errors import CaptureError
from tests.capture.readout.fake_board import BOARD_ID, KEY
from tests.support.errors import raises

OTHER_KEY = bytes(range(1, 17))


@pytest.fixture(autouse=True)
def settings_folder(tmp_path, monkeypatch):
    """Keys are stored in a folder of the test; one board is paired."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "settings"))
    store_board(BOARD_ID, "elbow", KEY, "")


def test_paired_boards_are_found_by_id_and_name(tmp_path):
    store_board("111111111111", "knee", OTHER_KEY, "192.168.1.7")
    assert [b.name for b in read_boards()] == ["elbow", "knee"]
    assert find_board("111111111111") == find_board("knee")
    assert (find_board("knee").key, find_board("knee").address) == (OTHER_KEY, "192.168.1.7")
    assert find_board("hip") is None
    store_board("111111111111", "hip", OTHER_KEY, "")
    assert find_board("knee") is None
    with raises(CaptureError, "board-name-taken", board=BOARD_ID):
        store_board("111111111111", "elbow", OTHER_KEY, "")
    file = tmp_path / "settings" / "boards.toml"
    if os.name == "posix":
        assert file.stat().st_mode & 0o777 == 0o600
    file.write_text(file.read_text("utf-8").replace(KEY.hex(), "secret"), "utf-8")
    with raises(CaptureError, "pairing-key-invalid") as caught:
        read_boards()
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("value", ["1122334455667788", '["112233"]', "{ a = 112233 }"])
def test_keys_do_not_appear_in_messages(tmp_path, value):
    assert "x01" not in repr(find_board("elbow"))
    file = tmp_path / "settings" / "boards.toml"
    file.write_text(file.read_text("utf-8").replace(f'"{KEY.hex()}"', value), "utf-8")
    with raises(CaptureError, "pairing-key-invalid") as caught:
        read_boards()
    assert "112233" not in f"{caught.value} {caught.value.data}"


@pytest.mark.parametrize(
    ("board_id", "name", "key", "code"),
    [
        ("xyz", "knee", KEY, "board-id-invalid"),
        ("111111111111", "a knee", KEY, "board-name-invalid"),
        ("111111111111", "knee", bytes(16), "pairing-key-invalid"),
        ("111111111111", "knee", KEY[:8], "pairing-key-invalid"),
    ],
)
def test_invalid_entries_are_not_stored(board_id, name, key, code):
    with raises(CaptureError, code):
        store_board(board_id, name, key, "")
    assert [b.name for b in read_boards()] == ["elbow"]


@pytest.mark.parametrize(
    "url",
    [
        "udp://",
        "udp://host:0",
        "udp://host:65536",
        "udp://host:port",
        "tcp://host?key=00",
        "tcp://host?key",
        "udp://host/path",
        "udp://user@host",
        "udp://[::1",
        "udp://[::1]x",
    ],
)
def test_invalid_urls(url):
    with raises(CaptureError, "port-url-invalid"):
        open_port(url)


@pytest.mark.parametrize(
    "url", ["socket://", "socket://host", "socket://host:99999", "socket://:5"]
)
def test_address_of_a_socket_is_checked(url):
    with raises(CaptureError, "port-url-invalid", port=url):
        open_port(url)
