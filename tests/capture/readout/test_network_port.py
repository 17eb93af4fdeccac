"""Read boards with Wi-Fi over networks that lose, reorder, repeat and forge packets.

The runs last `DEFSENSE_FIRMWARE_SECONDS` each; with `-s` they print what was measured. On the
loopback interface a packet arrives within a fraction of a millisecond if nothing delays it.
"""

import hashlib
import hmac
import os
import random
import socket
import struct
import threading
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from cobs import cobs

from defsense_fab.capture.clocks.clock_fit import fit_clocks
from defsense_fab.capture.readout.network_port import ReorderBuffer
from defsense_fab.capture.readout.paired_boards import store_board
from defsense_fab.capture.readout.ports import open_port
from defsense_fab.capture.readout.reader import Reader, ReadoutSettings
from defsense_fab.capture.readout.recording import Recorder, Replay, read_recording
from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.core.errors import CaptureError
from tests.capture.readout.fake_board import BOARD_ID, KEY, FakeBoard, Network, sums_of, tag
from tests.support.errors import raises

SECONDS = float(os.environ.get("DEFSENSE_FIRMWARE_SECONDS", "10"))
#: Packets that no board sent, per run of the usual length.
FORGERIES = int(os.environ.get("DEFSENSE_FORGERIES", "1000"))
OTHER_KEY = bytes(range(1, 17))


@pytest.fixture(autouse=True)
def settings_folder(tmp_path, monkeypatch):
    """Keys are stored in a folder of the test; the board is paired.

    A machine that stops both threads for a while is not taken for a silent board.
    """
    monkeypatch.setattr("defsense_fab.capture.readout.reader.SILENCE_S", 6.0)
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "settings"))
    store_board(BOARD_ID, "elbow", KEY, "")


class Sink:
    """Keeps the items of a reader with the times at which they were received, s."""

    def __init__(self):
        self._rows = []

    def __call__(self, item):
        self._rows.append((item, time.monotonic()))

    @property
    def events(self):
        return [item for item, _ in tuple(self._rows) if isinstance(item, Event)]

    def kinds(self):
        return [event.kind for event in self.events if event.kind != "info"]

    @property
    def last_counter(self):
        rows = (item for item, _ in reversed(tuple(self._rows)) if isinstance(item, StampedSample))
        return next(rows).sample.counter

    def samples(self):
        """Return samples with their times of reception, one list for each start of the board."""
        runs = [[]]
        for item, at in tuple(self._rows):
            if isinstance(item, Event) and item.kind == "restart":
                runs.append([])
            elif isinstance(item, StampedSample):
                runs[-1].append((item, at))
        return runs


def reader_of(url, sink):
    reader = Reader(partial(open_port, url), url, keep_items=False)
    reader.sink = sink
    return reader


def milliseconds(values):
    values = 1e3 * np.asarray(values)
    return f"median {np.median(values):.2f} ms, 99 % {np.quantile(values, 0.99):.2f} ms"


def wait_until(condition, seconds=60.0):
    """Wait for a condition; the limit is for machines that are very busy."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def close_after_last_sample(board, reader, sink):
    """Close a reader when nothing that the board sent is on its way any more."""
    board.pause()
    boot = board.boots[-1]
    last = max(set(boot.sent) - boot.dropped)
    wait_until(lambda: sink.last_counter == last)
    reader.close()


def check_counts(board, sink, statistics):
    """Check that every sample from the first to the last of a start is received or counted."""
    runs, lost = sink.samples(), 0
    assert len(runs) == len(board.boots)
    for boot, run in zip(board.boots, runs, strict=True):
        counters = [item.sample.counter for item, _ in run]
        assert counters == sorted(set(counters))
        assert all(item.sample.sums == sums_of(item.sample.counter) for item, _ in run)
        assert set(counters) <= set(boot.sent)
        lost += counters[-1] - counters[0] + 1 - len(counters)
    assert statistics.samples == sum(map(len, runs))
    assert statistics.lost == lost
    return runs


def alignment_errors(board, runs):
    """Return the errors of the fitted clock at the samples of each start, s."""
    errors = []
    for boot, run in zip(board.boots, runs, strict=True):
        device = np.array([item.device_us for item, _ in run]) / 1e6
        host = np.array([item.host_ns for item, _ in run]) / 1e9
        taken = np.array([boot.taken[item.sample.counter] for item, _ in run])
        errors.append(np.abs(fit_clocks(device, host).to_host(device) - taken))
    return np.concatenate(errors)


def latencies(board, runs):
    """Return the times from sending the samples to their reception, s."""
    pairs = zip(board.boots, runs, strict=True)
    return [at - boot.sent[item.sample.counter] for boot, run in pairs for item, at in run]


@pytest.mark.slow
def test_bad_network_and_a_restart():
    """Five percent are lost, others overtake or arrive twice, and the board restarts once."""
    network = Network(seed=3, loss=0.05, reordered=0.1, duplicates=0.05, delay=0.05)
    sink = Sink()
    with FakeBoard(drift=40e-6, network=network) as board, reader_of(board.url, sink) as reader:
        time.sleep(SECONDS / 2)
        board.reboot()
        wait_until(lambda: "restart" in sink.kinds())
        time.sleep(SECONDS / 2)
        close_after_last_sample(board, reader, sink)
        statistics = reader.statistics
        runs = check_counts(board, sink, statistics)
    assert sink.kinds() == ["start", "gap", "resumed", "restart"]
    events = {event.kind: event.data for event in sink.events}
    first, second = (boot.boot_id for boot in board.boots)
    assert (events["start"]["board_id"], events["start"]["boot_id"]) == (BOARD_ID, first)
    assert (events["resumed"]["board_id"], events["resumed"]["boot_id"]) == (BOARD_ID, second)
    assert KEY.hex() not in str(events)
    assert (statistics.gaps, statistics.restarts, statistics.bad) == (1, 1, 0)
    counts = statistics.network
    assert counts.reordered > 0
    assert counts.duplicates > 0
    dropped = sum(
        len([c for c in boot.dropped if run[0][0].sample.counter < c < run[-1][0].sample.counter])
        for boot, run in zip(board.boots, runs, strict=True)
    )
    # Late ones may be pongs. A busy machine sends many samples at once, which are then more than 64
    # packets ahead of delayed ones: these are rejected.
    assert dropped <= statistics.lost <= dropped + counts.late + counts.rejected
    assert all((np.diff([i.device_us for i, _ in run]) > 0).all() for run in runs)
    errors = alignment_errors(board, runs)
    assert np.median(errors) < 0.02
    print(
        f"\nUDP, {SECONDS:g} s at 100 Hz, 5 % lost, 10 % delayed by up to 50 ms, 5 % twice:"
        f" {statistics.samples} received, {statistics.lost} lost ({dropped} in the network),"
        f" {counts.summary}; clock error median {1e3 * np.median(errors):.3f} ms,"
        f" max {1e3 * errors.max():.3f} ms; send to sink {milliseconds(latencies(board, runs))}"
    )


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["udp", "tcp"])
def test_good_network(scheme):
    sink = Sink()
    with FakeBoard(scheme, drift=-30e-6) as board, reader_of(board.url, sink) as reader:
        time.sleep(SECONDS / 2)
        close_after_last_sample(board, reader, sink)
        runs = check_counts(board, sink, reader.statistics)
    errors = alignment_errors(board, runs)
    assert np.median(errors) < 0.02
    print(
        f"\n{scheme}, {SECONDS / 2:g} s at 100 Hz: {reader.statistics.samples} received,"
        f" {reader.statistics.lost} lost; clock error median {1e3 * np.median(errors):.3f} ms,"
        f" max {1e3 * errors.max():.3f} ms; send to sink {milliseconds(latencies(board, runs))}"
    )


def forge(rng, board):
    """Return bytes that the board did not send, or has sent before."""
    real = bytearray(rng.choice(board.genuine))
    kind = rng.choice(("random", "flip", "other key", "replay", "cut", "long", "challenge"))
    if kind == "random":
        return rng.randbytes(rng.randrange(600))
    if kind == "flip":
        real[rng.randrange(len(real))] ^= 1 << rng.randrange(8)
    elif kind == "other key":
        session = hmac.new(OTHER_KEY, b"defsense 1" + rng.randbytes(26), hashlib.sha256).digest()
        real[3:7] = struct.pack("<I", rng.randrange(1, 2**32))
        real[-16:] = tag(session, bytes(real[:-16]))
    elif kind == "cut":
        del real[rng.randrange(len(real)) :]
    elif kind == "long":
        real += rng.randbytes(rng.randrange(1, 2000))
    elif kind == "challenge":
        real = bytearray(b"\xd5\x01C" + rng.randbytes(26))
        real += tag(OTHER_KEY, bytes(real))
    return bytes(real)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["udp", "tcp"])
def test_no_forged_packet_is_accepted(scheme):
    """They come from the board's own address while it sends 100 samples per second."""
    rng, sink = random.Random(5), Sink()
    with FakeBoard(scheme) as board, reader_of(board.url, sink) as reader:
        wait_until(lambda: len(board.genuine) > 20)
        for _ in range(FORGERIES):
            board.send_raw(forge(rng, board))
            time.sleep(SECONDS / 2 / FORGERIES)
        seen = reader.statistics.samples
        wait_until(lambda: reader.statistics.samples > seen + 20)
        reader.close()
        statistics = reader.statistics
        runs = check_counts(board, sink, statistics)
    assert sink.kinds() == ["start"]
    assert statistics.bad == 0
    assert statistics.network.rejected > FORGERIES / 2
    print(
        f"\n{scheme}, {FORGERIES} forged packets among {statistics.samples} samples:"
        f" {statistics.lost} lost, {statistics.network.rejected} rejected,"
        f" {statistics.network.duplicates} duplicates; send to sink"
        f" {milliseconds(latencies(board, runs))}"
    )


@pytest.mark.slow
def test_stream_of_garbage_does_not_end_the_connection():
    """Over TCP, sequences without a zero byte are bounded, and the stream recovers after them."""
    rng, sink = random.Random(6), Sink()
    with FakeBoard("tcp") as board, reader_of(board.url, sink) as reader:
        for size in (10, 600, 70_000, 300_000):
            board.send_stream(bytes(1 + b % 255 for b in rng.randbytes(size)) + b"\0")
        wait_until(lambda: reader.statistics.network.rejected == 4)
        seen = reader.statistics.samples
        wait_until(lambda: reader.statistics.samples > seen + 20)
        reader.close()
        check_counts(board, sink, reader.statistics)
    assert sink.kinds() == ["start"]


def test_settings_reach_a_board_over_a_bad_network():
    network = Network(seed=4, loss=0.2, reordered=0.3, duplicates=0.3)
    with FakeBoard(network=network) as board:
        settings = ReadoutSettings(channels=5, average=2, rate=50)
        reader = Reader(partial(open_port, board.url), board.url, settings)
        with reader:
            info = reader.info
            wait_until(lambda: reader.statistics.samples > 3)
        assert (info.channels, info.averages, info.rate) == (5, 2, 50)


@pytest.mark.parametrize("scheme", ["udp", "tcp"])
def test_errors_before_the_first_sample(scheme, monkeypatch):
    monkeypatch.setattr("defsense_fab.capture.readout.network_port.CONNECT_TIMEOUT_S", 0.5)
    with FakeBoard(scheme, board_id="111111111111") as board:
        with raises(CaptureError, "board-not-paired", board="111111111111"):
            open_port(board.url)
        store_board("111111111111", "knee", OTHER_KEY, "")
        with raises(CaptureError, "pairing-key-differs", board="111111111111"):
            open_port(board.url)
        store_board("111111111111", "knee", KEY, "")
        with raises(CaptureError, "board-address-unknown", board="111111111111"):
            open_port(f"{scheme}://knee")
        open_port(board.url).close()
        open_port(f"{scheme}://knee").close()  # the address was stored
        store_board(BOARD_ID, "elbow", KEY, f"127.0.0.1:{board.port}")
        with raises(CaptureError, "board-differs", board="111111111111", expected=BOARD_ID):
            open_port(f"{scheme}://elbow")
        port = board.port
    with raises(CaptureError, "board-unreachable", host="127.0.0.1", port=port):
        open_port(board.url)
    with raises(CaptureError, "host-unknown", host="no.such.host.invalid"):
        open_port(f"{scheme}://no.such.host.invalid")


def test_board_without_a_key_is_read_only_on_request(monkeypatch):
    monkeypatch.setattr("defsense_fab.capture.readout.network_port.CONNECT_TIMEOUT_S", 0.5)
    with FakeBoard(key=bytes(16)) as board:
        with raises(CaptureError, "pairing-key-differs"):
            open_port(board.url)
        with Reader(partial(open_port, f"{board.url}?key=none"), board.url) as reader:
            wait_until(lambda: reader.statistics.samples > 3)
    with FakeBoard() as board, raises(CaptureError, "pairing-key-differs"):
        open_port(f"{board.url}?key=none")


@pytest.mark.slow
def test_another_board_at_the_same_address_is_not_read():
    """The reader states it once, and waits for the board that it read at first."""
    store_board("111111111111", "knee", KEY, "")
    sink = Sink()
    first = FakeBoard()
    with reader_of(first.url, sink) as reader:
        wait_until(lambda: reader.statistics.samples > 10)
        first.close()
        with FakeBoard(board_id="111111111111", port=first.port) as other:
            wait_until(lambda: "gap" in sink.kinds())
            seen = reader.statistics.samples
            wait_until(lambda: other.hellos > 1)
            wait_until(lambda: sink.kinds().count("gap") == 2)
            assert reader.statistics.samples == seen
            assert not other.boots[0].sent
        with FakeBoard(port=first.port, seed=2):
            wait_until(lambda: reader.statistics.samples > seen + 10)
    assert sink.kinds() == ["start", "gap", "gap", "resumed", "restart"]


def test_reorder_buffer_waits_for_missing_packets():
    """It releases what is in order, and the rest after the delay; later packets are refused."""
    buffer = ReorderBuffer(3600.0)
    assert buffer.add(2, b"two", 0)
    assert buffer.add(1, b"one", 5)
    now = time.monotonic_ns()
    assert buffer.release() == [(b"one", 5), (b"two", 5)]
    assert buffer.add(5, b"five", now)
    assert buffer.add(4, b"", now)
    assert buffer.release() == []
    assert 3500 < buffer.time_left() <= 3600
    patient = ReorderBuffer(0.0)
    assert patient.add(3, b"three", now)
    assert patient.release() == [(b"three", now)]
    assert not patient.add(2, b"two", now)
    assert patient.time_left() == float("inf")


class WindowsSocket(socket.socket):
    """A socket that fails if a datagram is longer than its buffer, as those of Windows do."""

    def recv(self, size):
        data = super().recv(1 << 16)
        if len(data) > size:
            raise OSError(10040, "the message was larger than the buffer")
        return data


def test_long_datagram_does_not_end_the_connection(monkeypatch):
    monkeypatch.setattr(
        "defsense_fab.capture.readout.network_links.socket",
        SimpleNamespace(**{**vars(socket), "socket": WindowsSocket}),
    )
    with FakeBoard() as board, Reader(partial(open_port, board.url), board.url) as reader:
        board.send_raw(bytes(2000))
        wait_until(lambda: reader.statistics.network.rejected == 1)
        seen = reader.statistics.samples
        wait_until(lambda: reader.statistics.samples > seen + 3)


class ReplayingBoard(FakeBoard):
    """A board whose challenges to the first hello arrive again right behind its first pong."""

    def __init__(self):
        super().__init__("tcp")
        self._held, self._is_held = [], True

    def _put(self, data):
        if data[2:3] == b"C":
            self._held.append(data)
            if len(self._held) == 1:  # lost, so that the host sends another hello
                return
        if data[2:3] == b"Q" and self._is_held:
            self._is_held = False
            packets = [data, self._held[0]]
            self._peer.sendall(b"".join(cobs.encode(packet) + b"\0" for packet in packets))
        else:
            super()._put(data)


def test_replayed_challenge_does_not_end_a_confirmed_session():
    with ReplayingBoard() as board, Reader(partial(open_port, board.url), board.url) as reader:
        wait_until(lambda: reader.statistics.samples > 3)


def test_recording_over_a_reordering_network_is_played_as_one_run(tmp_path):
    """Arrival times that go back would be those of another run, and be played after a pause."""
    path = tmp_path / "run.csv"
    network = Network(seed=7, reordered=0.5, delay=0.015)
    with FakeBoard(rate=200, network=network) as board, Recorder(path, 3) as recorder:
        reader = Reader(partial(open_port, board.url), board.url, keep_items=False)
        reader.sink = recorder.add
        with reader:
            wait_until(lambda: reader.statistics.samples > 100)
        assert reader.statistics.network.reordered > 0
    recording = read_recording(path)
    assert (np.diff(recording.host_ns) >= 0).all()
    replay = Replay(path, speed=1e3)
    replay.start()
    items = []
    wait_until(lambda: items.extend(replay.drain()) or len(items) == len(recording.counter))
    assert items[-1].device_us - items[0].device_us == np.ptp(recording.device_us)


def test_commands_may_come_from_another_thread():
    """Sequences are unique, so no command is taken for a replay."""
    sink = Sink()
    with FakeBoard("tcp") as board, reader_of(board.url, sink) as reader:
        senders = [
            threading.Thread(target=lambda: [reader.send("version") for _ in range(20)])
            for _ in range(3)
        ]
        for sender in senders:
            sender.start()
        for sender in senders:
            sender.join(120)
        wait_until(lambda: sum(event.kind == "info" for event in sink.events) >= 60)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["udp", "tcp"])
def test_access_point_that_drops(scheme):
    """It is one gap without a restart, and the counter shows what was lost meanwhile."""
    sink = Sink()
    with FakeBoard(scheme) as board, reader_of(board.url, sink) as reader:
        wait_until(lambda: reader.statistics.samples > 10)
        board.network_is_down = True
        wait_until(lambda: "gap" in sink.kinds())
        seen = reader.statistics.samples
        board.network_is_down = False
        wait_until(lambda: reader.statistics.samples > seen + 10)
        reader.close()
        check_counts(board, sink, reader.statistics)
        assert reader.statistics.lost > 50
    assert sink.kinds() == ["start", "gap", "resumed"]
