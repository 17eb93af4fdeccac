"""The compiled firmware on simulated boards; skipped where the AVR tools are missing."""

import subprocess
import time
from collections import defaultdict

import pytest

from tests.firmware import build


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """Return the folder with board, golden, divider.elf and ads1115.elf."""
    if missing := build.missing_packages():
        pytest.skip(f"not installed: {' '.join(missing)}")
    folder = tmp_path_factory.mktemp("firmware")
    build.build_board(folder)
    build.build_golden(folder)
    for name in build.SKETCHES:
        build.build_sketch(name, folder)
    return folder


class Board:
    """A running board; `port` is its serial port."""

    def __init__(self, folder, log, sketch, *options):
        self._log = log
        command = [folder / "board", folder / f"{sketch}.elf", "--log", log, *options]
        self._process = subprocess.Popen(
            [str(c) for c in command], stdout=subprocess.PIPE, text=True
        )
        self.port = self._process.stdout.readline().strip()

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


@pytest.fixture
def board(built, tmp_path):
    """Return a function that starts a board; all boards are stopped at the end."""
    boards = []

    def start(sketch="divider", *options):
        boards.append(Board(built, tmp_path / f"log-{len(boards)}", sketch, *options))
        return boards[-1]

    yield start
    for one in boards:
        one.stop()


def collect(reader, seconds):
    """Collect samples and events of a reader for a time in s."""
    out, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        out += reader.drain()
        time.sleep(0.02)
    return out
