"""The reader of a simulated board over real ports: greeting, gaps, errors and clocks."""

import contextlib
import json
import os
import socket
import threading
import time
import tty
from functools import partial

import numpy as np
import pytest

from defsense_fab.capture.clocks.clock_fit import fit_clocks
from defsense_fab.capture.readout.ports import Port, open_port
from defsense_fab.capture.readout.reader import Reader, ReadoutSettings
from defsense_fab.capture.readout.recording import Recorder, read_recording
from defsense_fab.capture.readout.source import Event, StaleError, StampedSample
from defsense_fab.cli.main import main
from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.sensing.response import Response
from defsense_fab.sensing.serial_frames import Info, Sample, encode
from defsense_fab.twin.electronics.cords import CordTraits, SpecimenTwin
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from tests.support.errors import raises


def board(speed=1.0):
    rng = np.random.default_rng(0)
    return ReadoutTwin(SpecimenTwin(CordTraits(Response.line(2.0)), rng), speed=speed)


class PluggedBoard:
    """A simulated board on a pseudo-terminal, until it is unplugged."""

    def __init__(self, twin):
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.path, self._twin = os.ttyname(slave), twin
        os.close(slave)
        os.set_blocking(self._master, False)
        self._gone = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._gone.is_set():
            with contextlib.suppress(OSError):  # nothing was written, or the other end is closed
                self._twin.write(os.read(self._master, 1000))
            data = self._twin.read(4096)
            if data:
                with contextlib.suppress(OSError):
                    os.write(self._master, data)

    def unplug(self):
        self._gone.set()
        self._thread.join()
        os.close(self._master)


@pytest.fixture
def plug():
    plugged = []

    def on(twin):
        plugged.append(PluggedBoard(twin))
        return plugged[-1]

    yield on
    for one in plugged:
        if not one._gone.is_set():
            one.unplug()


def gather(reader, seconds):
    out, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        out += reader.drain()
        time.sleep(0.01)
    return out


def kinds(items):
    return [i.kind for i in items if isinstance(i, Event) and i.kind not in ("info", "text")]


def test_settings_can_depend_on_the_board():
    def choose(info):
        return ReadoutSettings(channels=2, average=info.averages // 2, rate=80)

    with contextlib.closing(Reader(board, "twin", choose)) as reader:
        reader.start()
        settings = reader.info.channels, reader.info.averages, reader.info.rate
        assert settings == (2, 8, 80)


@pytest.mark.slow
def test_unplugged_in_the_middle_of_a_recording(plug, tmp_path):
    """The file holds all frames before and after, and marks the gap."""
    link = tmp_path / "port"
    first = plug(board())
    link.symlink_to(first.path)
    reader = Reader(partial(open_port, str(link)), "port", ReadoutSettings(rate=100))
    items = []
    with reader, Recorder(tmp_path / "r.csv", 3) as recorder:
        items += gather(reader, 0.6)
        first.unplug()
        items += gather(reader, 0.4)
        with raises(StaleError, "reading-stale"):
            reader.read_latest(0.2)
        link.unlink()
        link.symlink_to(plug(board()).path)
        items += gather(reader, 2)
        assert reader.read_latest(0.2).sample.sums
        assert reader.statistics.gaps == 1
        recorder.extend(items)
    assert kinds(items) == ["start", "gap", "resumed", "restart"]
    result = read_recording(tmp_path / "r.csv")
    samples = [i for i in items if isinstance(i, StampedSample)]
    assert result.counter.tolist() == [s.sample.counter for s in samples]
    at = {e["event"]: n for n, e in result.events}
    before, after = result.counter[: at["gap"]], result.counter[at["resumed"] :]
    assert len(before) > 30
    assert len(after) > 60
    assert (np.diff(before) == 1).all()
    assert (np.diff(after) == 1).all()
    assert (np.diff(result.device_us) > 0).all()
    around = [at["gap"] - 1, at["resumed"]]
    gap_us, gap_ns = (np.diff(times[around])[0] for times in (result.device_us, result.host_ns))
    assert gap_us / 1e6 == pytest.approx(gap_ns / 1e9, abs=0.1)


def test_over_a_socket():
    """A program sends the same bytes as a board."""
    twin, server = board(), socket.create_server(("127.0.0.1", 0))

    def serve():
        connection, _ = server.accept()
        connection.settimeout(0.01)
        with connection:
            while True:
                try:
                    data = connection.recv(1000)
                    if not data:
                        return
                    twin.write(data)
                except TimeoutError:
                    pass
                except OSError:
                    return
                connection.sendall(twin.read(4096))

    thread = threading.Thread(target=serve)
    thread.start()
    url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    with Reader(partial(open_port, url), url, ReadoutSettings(average=4)) as reader:
        items = gather(reader, 0.5)
    server.close()
    thread.join(120)
    assert len([i for i in items if isinstance(i, StampedSample)]) > 15


def test_ports_that_are_absent_busy_or_unusable(plug, tmp_path):
    with raises(CaptureError, "port-not-found", port="/dev/ttyUSB77"):
        open_port("/dev/ttyUSB77")
    port = plug(board()).path
    busy_port = open_port(port)
    with raises(CaptureError, "port-busy", port=port):
        open_port(port)
    busy_port.close()
    (tmp_path / "file").write_text("x")
    with raises(CaptureError, "port-unavailable"):
        open_port(str(tmp_path / "file"))


class ConstantPort:
    """A port that always sends the same bytes."""

    def __init__(self, data):
        self._data = data

    in_waiting = 1

    def read(self, size):
        time.sleep(0.01)
        return self._data

    def write(self, data):
        return len(data)

    def close(self):
        pass


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"", "board-silent"),
        (b"T=21.5;H=40\r\n", "board-firmware-unknown"),
        (encode(Info(2, (2, 0), 0, 3, 16, 50, 0, 8, 1024)), "firmware-protocol-differs"),
        (encode(Info(1, (1, 0), 1, 0, 16, 50, 0, 0, 26400)), "converter-not-found"),
        (encode(Info(1, (1, 0), 0, 3, 16, 50, 0, 8, 1024)), "board-command-unanswered"),
    ],
)
def test_another_device_or_a_wrong_board_answers(monkeypatch, data, code):
    monkeypatch.setattr("defsense_fab.capture.readout.greeting.GREETING_TIMEOUT_S", 0.3)
    with raises(CaptureError, code):
        Reader(lambda: ConstantPort(data), "port", ReadoutSettings(channels=5)).start()


def test_readings_are_fresh():
    with Reader(board, "twin", ReadoutSettings(rate=50)) as reader:
        gather(reader, 0.3)
        assert time.monotonic_ns() - reader.read_latest(0.2).host_ns < 0.2e9
    quiet = Reader(lambda: ConstantPort(encode(Info(1, (1, 0), 0, 3, 16, 50, 0, 8, 1024))), "p")
    with quiet, raises(StaleError, "no-sample-yet"):
        quiet.read_latest(1.0)


def test_sink_receives_everything_and_its_error_is_raised():
    """A full disk must not end the thread silently."""
    seen = []

    def sink(item):
        seen.append(item)
        if len(seen) > 10:
            raise StorageError("the disk is full", code="disk-full")

    reader = Reader(board, "twin", ReadoutSettings(rate=50))
    reader.sink = sink
    with reader:
        received = gather(reader, 0.15)
        time.sleep(0.4)
        with raises(StorageError, "disk-full"):
            gather(reader, 0.3)
    assert received == seen[: len(received)]


def test_read_latest_raises_the_error_that_ended_the_reader():
    """A full disk is not an unplugged board."""

    def sink(item):
        if isinstance(item, StampedSample):
            raise StorageError("the disk is full", code="disk-full")

    reader = Reader(board, "twin", ReadoutSettings(rate=50))
    reader.start()
    reader.sink = sink
    reader._thread.join(120)
    with raises(StorageError, "disk-full"):
        reader.read_latest(10.0)
    reader.close()


def samples(reader, numbers):
    for n in numbers:
        reader._receive(Sample(n, 20_000 * n, False, False, 1, (1,)), n * 20_000_000)


def test_items_that_are_not_drained_are_dropped_and_counted(monkeypatch):
    """Memory is bounded, losses are reported, and a sink still receives everything."""
    monkeypatch.setattr("defsense_fab.capture.readout.reader.MAX_WAITING_ITEMS", 10)
    reader, written = Reader(board, "twin"), []
    reader.sink = written.append
    samples(reader, range(25))
    assert [i.sample.counter for i in written] == list(range(25))
    first, *rest = reader.drain()
    assert (first.kind, first.data) == ("dropped", {"items": 15})
    assert [i.sample.counter for i in rest] == list(range(15, 25))
    assert reader.statistics.dropped == 15
    samples(reader, range(25, 30))
    assert [i.sample.counter for i in reader.drain()] == list(range(25, 30))
    assert reader.statistics.dropped == 15


class SlowPort(ConstantPort):
    """A port whose `write`, and optionally `read`, waits for `resume`."""

    def __init__(self, reads=False):
        super().__init__(b"")
        self.entered, self.resume, self.closed = threading.Event(), threading.Event(), False
        self._reads, self.closed_under_it = reads, False

    def _wait(self):
        self.entered.set()
        self.resume.wait(120)
        self.closed_under_it |= self.closed

    def write(self, data):
        self._wait()
        return len(data)

    def read(self, size):
        if self._reads:
            self._wait()
        return b""

    def close(self):
        self.closed = True


def test_port_is_not_closed_under_a_command():
    port, reader = SlowPort(), Reader(board, "twin")
    reader._port = port
    sender = threading.Thread(target=reader.send, args=("led 1",))
    sender.start()
    assert port.entered.wait(120)
    closer = threading.Thread(target=reader.close)
    closer.start()
    closer.join(0.2)
    port.resume.set()
    sender.join(120)
    closer.join(120)
    assert not port.closed_under_it
    assert port.closed
    reader.send("led 2")  # without a port: no error


def test_port_with_a_hanging_driver_is_closed_by_its_thread(monkeypatch):
    monkeypatch.setattr(
        "defsense_fab.capture.readout.reader.THREAD_JOIN_TIMEOUT_S", 0.1, raising=False
    )
    port, reader = SlowPort(reads=True), Reader(board, "twin")
    reader._port = port
    reader._thread.start()
    assert port.entered.wait(120)
    reader.close()
    assert not port.closed
    port.resume.set()
    reader._thread.join(120)
    assert port.closed
    assert not port.closed_under_it


def test_wrapping_clock_continues():
    """`micros()` restarts after 71 minutes; the device's time continues."""
    reader = Reader(board, "twin")
    last = 2**32 - 30_000
    for n in range(4):
        reader._receive(
            Sample(n, (last + 20_000 * n) % 2**32, False, False, 1, (1,)), n * 20_000_000
        )
    times = [i.device_us for i in reader.drain()]
    assert np.diff(times).tolist() == [20_000] * 3


@pytest.mark.parametrize("drift", [-80e-6, 0.0, 200e-6])
def test_clock_offset_and_drift_are_fitted(drift):
    """Arrivals are late at random by up to 30 ms, and once by 2 s."""
    rng = np.random.default_rng(0)
    device = np.arange(0, 600, 0.02)
    late = 0.002 + rng.exponential(0.008, len(device))
    late[1000] += 2
    host = 5000 + (1 + drift) * device + late
    result = fit_clocks(device, host)
    assert result.drift == pytest.approx(drift, abs=2e-6)
    assert result.to_host(device) == pytest.approx(host - late + 0.002, abs=0.001)
    one = fit_clocks(device[:1], host[:1])
    assert one.drift == 0


def test_command_lists_ports_with_their_values(plug, monkeypatch, capsys):
    good = Port(plug(board()).path, "USB Serial")
    monkeypatch.setattr(
        "defsense_fab.workflow.board.readout.serial_ports",
        lambda: [good, Port("/dev/none", "")],
    )
    assert main(["board", "ports"]) == 0
    output = capsys.readouterr().out
    assert f"{good.device:<16} USB Serial" in output
    assert "/dev/none" in output
    assert output.count("ohm") == 3
    assert "█" in output
    assert f"--port {good.device}" in output.splitlines()[-1]
    assert main(["board", "ports", "--list", "--json"]) == 0
    assert [p["device"] for p in json.loads(capsys.readouterr().out)] == [good.device, "/dev/none"]
    monkeypatch.setattr("defsense_fab.workflow.board.readout.serial_ports", lambda: [])
    assert main(["board", "ports"]) == 0
    assert "/dev/" not in capsys.readouterr().out


class SampleBoard(ConstantPort):
    """A board that describes itself, and sends two samples at a time, or none."""

    def __init__(self):
        super().__init__(encode(Info(1, (1, 0), 0, 3, 16, 50, 0, 8, 1024)))
        self.sends, self._counter = True, 0

    def read(self, size):
        data = super().read(size)
        if not self.sends:
            return data
        self._counter += 2
        for n in (self._counter - 1, self._counter):
            data += encode(Sample(n, 20_000 * n, False, False, 16, (100, 200, 300)))
        return data


def test_silent_board_is_reported_once(monkeypatch):
    """It answers greetings, but has resumed only when samples arrive again."""
    for name, value in (("SILENCE_S", 0.4), ("SILENCE_SAMPLES", 1), ("REOPEN_INTERVAL_S", 0.01)):
        monkeypatch.setattr(f"defsense_fab.capture.readout.reader.{name}", value)
    board = SampleBoard()
    with Reader(lambda: board, "port") as reader:
        before = gather(reader, 0.3)
        board.sends = False
        silent = gather(reader, 1.6)
        board.sends = True
        after = gather(reader, 1.0)
        assert reader.statistics.gaps == 1
    assert kinds(before + silent) == ["start", "gap"]
    gap = next(i for i in silent if isinstance(i, Event) and i.kind == "gap")
    assert gap.data["why"].startswith("silent")
    again = [i for i in after if not (isinstance(i, Event) and i.kind == "info")]
    assert (again[0].kind, again[0].data["full_scale"]) == ("resumed", 1024)
    assert len(again) > 10
    assert all(isinstance(i, StampedSample) for i in again[1:])


def test_error_of_a_sink_after_a_gap_is_raised():
    """The port is not reopened repeatedly because of it."""

    def sink(item):
        if isinstance(item, StampedSample):
            raise CaptureError("a frame of 3 channels", code="channels-differ")

    gone = Reader(SampleBoard, "port")
    gone.sink = sink
    with raises(CaptureError, "channels-differ"):
        gone._reopen()


@pytest.mark.slow
def test_board_that_is_reset_behind_an_open_port():
    """It sends plain lines until it is greeted again."""
    twin = board()
    with Reader(lambda: twin, "twin", ReadoutSettings(rate=50)) as reader:
        before = gather(reader, 0.4)
        twin.write(b"plain\n")
        after = gather(reader, 3.5)
        assert reader.read_latest(0.5)
    assert kinds(before + after) == ["start", "gap", "resumed"]
    assert sum(isinstance(i, StampedSample) for i in after) > 30
