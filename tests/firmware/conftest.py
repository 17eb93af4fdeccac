"""The compiled firmware on simulated boards; skipped where the AVR tools are missing."""

import os
import signal
import subprocess
import time
from collections import defaultdict

import pytest
import serial

from defsense_fab.capture.boards import stk500
from defsense_fab.capture.readout import greeting, reader
from tests.firmware import build


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """Wait longer for boards that are simulated on a busy machine."""
    monkeypatch.setattr(stk500, "SYNC_TIMEOUT_S", 1.5)
    monkeypatch.setattr(stk500, "SYNC_TRIES", 1)
    monkeypatch.setattr(stk500, "ANSWER_TIMEOUT_S", 20)
    monkeypatch.setattr(greeting, "GREETING_TIMEOUT_S", 20)
    monkeypatch.setattr(reader, "SILENCE_S", 30)


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """Return the folder with board, golden, divider.elf and ads1115.elf."""
    if missing := build.missing_packages():
        pytest.skip(f"not installed: {' '.join(missing)}")
    folder = tmp_path_factory.mktemp("firmware")
    build.build_board(folder)
    build.build_golden(folder)
    for name in build.BOOT_LOADERS:
        build.build_bootloader(name, folder)
    for name in build.SKETCHES:
        build.build_sketch(name, folder)
    return folder


class Board:
    """A running board.

    Attributes:
        port: Its serial port. As a pty, it has no DTR.
        url: The same port with a DTR that resets the board, for `open_port`.
    """

    def __init__(self, folder, log, sketch, *options):
        self._log = log
        firmware = [folder / f"{sketch}.elf"] if sketch else []
        command = [folder / "board", *firmware, "--log", log, *options]
        self._process = subprocess.Popen(
            [str(c) for c in command], stdout=subprocess.PIPE, text=True
        )
        self.port = self._process.stdout.readline().strip()
        self.url = f"board://{self._process.pid}{self.port}"

    def press_reset(self):
        self._process.send_signal(signal.SIGUSR1)

    def wait(self, timeout):
        self._process.wait(timeout)

    def stop(self):
        self._process.terminate()
        self._process.wait(120)
        self._process.stdout.close()

    def conversions(self):
        """Return cycles and counts of each channel in order, after the board has stopped."""
        out = defaultdict(list)
        for line in self._log.read_text("utf-8").splitlines():
            cycle, channel, count = map(int, line.split())
            if channel != 200:
                out[channel % 100].append((cycle, max(count, 0)))
        return out


class ResettingPort(serial.Serial):
    """A pty whose DTR resets the simulated board, as the capacitor of an Arduino does.

    The reset follows DTR when it is switched on. An open port has it on, a closed one off.
    """

    _was_on = False

    @property
    def port(self):
        return self._port

    @port.setter
    def port(self, url):
        self._pid, _, path = (url or "").removeprefix("board://").partition("/")
        serial.Serial.port.fset(self, f"/{path}" if path else None)

    def _update_dtr_state(self):
        if self._dtr_state and not self._was_on:
            os.kill(int(self._pid), signal.SIGUSR1)
        self._was_on = self._dtr_state

    def _update_rts_state(self):
        """Nothing is connected to RTS."""

    def close(self):
        super().close()
        self._was_on = False


@pytest.fixture
def board(built, tmp_path, monkeypatch):
    """Return a function that starts a board; all boards are stopped at the end.

    The ports `board://...` of pyserial are those of boards.
    """
    monkeypatch.setattr(serial, "serial_for_url", _open_url(serial.serial_for_url))
    boards = []

    def start(sketch="divider", *options):
        boards.append(Board(built, tmp_path / f"log-{len(boards)}", sketch, *options))
        return boards[-1]

    yield start
    for one in boards:
        one.stop()


def _open_url(open_other):
    def open_url(url, **options):
        if not url.startswith("board://"):
            return open_other(url, **options)
        port = ResettingPort()
        port.port = url
        return port

    return open_url


def collect(reader, seconds):
    """Collect samples and events of a reader for a time in s."""
    out, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        out += reader.drain()
        time.sleep(0.02)
    return out
