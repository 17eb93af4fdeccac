"""The program under CPython with sockets of this machine, read by the host over UDP and TCP."""

import contextlib
import os
import socket
import time
from functools import partial

import numpy as np
import pytest

from defsense_fab.capture.readout.paired_boards import read_boards, store_board
from defsense_fab.capture.readout.ports import open_port
from defsense_fab.capture.readout.reader import Reader, ReadoutSettings
from defsense_fab.capture.readout.source import StampedSample
from defsense_fab.core.errors import CaptureError
from defsense_fab.sensing.packets import OPEN_KEY
from tests.support.errors import raises

KEY = bytes(range(16))
BOARD_ID = "a4cf12345678"
STORED = {"name": "lab", "key": KEY.hex()}
WAIT_S = 30  # of what takes a moment, on a busy machine


def read(url, settings=None):
    return Reader(partial(open_port, url), url, settings)


def collect(reader, count):
    """Return at least `count` samples."""
    samples, end = [], time.monotonic() + WAIT_S
    while len(samples) < count and time.monotonic() < end:
        time.sleep(0.05)
        samples += [i for i in reader.drain() if isinstance(i, StampedSample)]
    assert len(samples) >= count
    return samples


@pytest.fixture
def paired():
    store_board(BOARD_ID, "elbow", KEY, "127.0.0.1")


@pytest.mark.parametrize("scheme", ["udp", "tcp"])
def test_samples_over_wifi_equal_those_over_usb(start_board, scheme):
    """Both ports are read at the same time."""
    board = start_board(STORED)
    store_board(BOARD_ID, "elbow", KEY, f"127.0.0.1:{getattr(board, scheme)}")
    settings = ReadoutSettings(channels=4, average=2, rate=100)
    with read(f"{scheme}://elbow", settings) as network, read(board.serial) as serial:
        assert network.info == serial.info
        over_network, over_usb = collect(network, 100), collect(serial, 100)
        statistics = network.statistics
    usb = {i.sample.counter: i.sample for i in over_usb}
    common = [i.sample for i in over_network if i.sample.counter in usb]
    assert len(common) > 50
    assert all(usb[s.counter] == s for s in common)
    assert (statistics.bad, statistics.network.rejected) == (0, 0)
    counters = [i.sample.counter for i in over_network]
    assert (np.diff(counters) == 1).all() or any(i.sample.late for i in over_network)


def test_board_with_another_key_is_refused(start_board, paired):
    board = start_board({"name": "lab", "key": "ff" * 16})
    with raises(CaptureError, "pairing-key-differs"):
        read(f"udp://127.0.0.1:{board.udp}").start()


def test_board_without_key_answers_nobody(start_board, paired):
    board = start_board({"name": "lab"})
    with raises(CaptureError, "board-unreachable"):
        read(f"udp://127.0.0.1:{board.udp}").start()


def test_board_with_open_key_is_read_on_request(start_board):
    board = start_board({"name": "lab", "key": OPEN_KEY.hex()})
    with raises(CaptureError, "board-not-paired"):
        read(f"udp://127.0.0.1:{board.udp}").start()
    with read(f"udp://127.0.0.1:{board.udp}?key=none") as reader:
        collect(reader, 20)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["udp", "tcp"])
def test_reading_resumes_after_the_board_restarts(start_board, paired, scheme, monkeypatch):
    monkeypatch.setattr("defsense_fab.capture.readout.reader.SILENCE_S", 3.0)
    first = start_board(STORED)
    port = getattr(first, scheme)
    with read(f"{scheme}://127.0.0.1:{port}") as reader:
        before = collect(reader, 20)
        first.stop()
        # UDP and TCP have different free ports here, the restarted board has one for both.
        start_board(port=port)
        after = collect(reader, 20)
        statistics = reader.statistics
    assert (statistics.gaps, statistics.restarts) == (1, 1)
    assert after[-1].device_us > before[-1].device_us


def test_key_is_set_over_usb_while_samples_are_read(start_board):
    board = start_board({})
    with read(board.serial) as serial:
        serial.send(f"key {KEY.hex()}")
        serial.send("wifi lab")
        samples = collect(serial, 20)
        store_board(BOARD_ID, "elbow", KEY, f"127.0.0.1:{board.udp}")
        with read("udp://elbow") as network:
            collect(network, 20)
        samples += collect(serial, 20)
    assert (np.diff([i.sample.counter for i in samples]) > 0).all()
    assert read_boards()[0].board_id == BOARD_ID


def test_garbage_over_tcp_closes_the_connection_and_other_hosts_are_read(start_board, paired):
    board = start_board(STORED)
    strangers = [socket.create_connection(("127.0.0.1", board.tcp)) for _ in range(5)]
    for stranger in strangers:
        stranger.sendall(os.urandom(3000).replace(b"\0", b"\1"))
    with read(f"tcp://127.0.0.1:{board.tcp}") as reader:
        collect(reader, 20)
    for stranger in strangers:
        stranger.settimeout(WAIT_S)
        with contextlib.suppress(ConnectionResetError):
            assert stranger.recv(10) == b""
        stranger.close()
