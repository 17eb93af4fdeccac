"""The firmware as it runs on a board, read by the host's own code over a pseudo-terminal."""

import os
import subprocess
import time
from functools import partial

import numpy as np
import pytest
from defsense_fab.workflow.doctor import boards

from defsense_fab.capture.readout.ports import open_port
from defsense_fab.capture.readout.reader import Reader, ReadoutSettings
from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises
from tests.firmware.build import FIRMWARE
from tests.firmware.conftest import collect

#: Simulated seconds of the long runs.
SECONDS = int(os.environ.get("DEFSENSE_FIRMWARE_SECONDS", "6"))


def test_golden_frames_in_c(built):
    done = subprocess.run(
        [built / "golden", FIRMWARE / "golden.txt"], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "17 golden frames, 0 wrong\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sketch", "settings", "options"),
    [
        ("divider", ReadoutSettings(channels=3, average=16, rate=50), ()),
        ("divider", ReadoutSettings(channels=8, average=4, rate=100), ()),
        ("ads1115", ReadoutSettings(channels=16, average=1, rate=75), ("--ads", "4")),
    ],
)
def test_every_sample_is_what_the_converter_read(board, sketch, settings, options):
    """No bad frame, no sample lost, and every sum that of the conversions that were fed in."""
    running = board(sketch, "--fast", "--seconds", SECONDS, *options)
    reader = Reader(partial(open_port, running.port), "board", settings)
    info = reader.start()
    items = []
    while not any(isinstance(i, Event) and i.kind == "gap" for i in items):
        items += collect(reader, 0.2)
    statistics = reader.statistics
    reader.close()
    running.wait(10)
    assert (info.channels, info.averages, info.rate) == (
        settings.channels, settings.average, settings.rate,
    )  # fmt: skip
    # What came during the greeting was still taken with other settings; the rate comes last: what
    # came before the first step of its length, more on a busy machine, is of another rate.
    samples = [
        i.sample
        for i in items
        if isinstance(i, StampedSample)
        and (len(i.sample.sums), i.sample.averages) == (settings.channels, settings.average)
    ]
    steps = np.diff([s.micros for s in samples])
    begin = int(np.argmax(np.abs(steps - 1e6 / settings.rate) < 100))
    samples = samples[begin + 2 :]
    assert statistics.bad <= 1  # the line in which the reader came in
    assert len(samples) > 0.7 * SECONDS * settings.rate
    assert (np.diff([s.counter for s in samples]) == 1).all()
    assert not any(s.late for s in samples)
    sums = np.array([s.sums for s in samples])
    middle = 16 * np.array([s.micros for s in samples])  # cycles
    half = 16_000_000 // settings.rate // 2
    fed = running.conversions()
    for channel in range(settings.channels):
        cycle, count = np.array(fed[channel]).T
        total = np.append(0, np.cumsum(count))
        first, last = (np.searchsorted(cycle, middle + sign * half) for sign in (-1, 1))
        assert (last - first == settings.average).all()
        assert (total[last] - total[first] == sums[:, channel]).all()


def test_the_host_sets_the_board_up(board):
    running = board("divider")
    reader = Reader(partial(open_port, running.port), "board", ReadoutSettings(2, 8, 40, 100))
    with reader:
        info = reader.info
        assert (info.channels, info.averages, info.rate, info.led_period) == (2, 8, 40, 100)
        items = [i for i in collect(reader, 1.5) if isinstance(i, StampedSample)]
        reader.send("rate 9999")
        texts = [
            i.data["text"]
            for i in collect(reader, 0.5)
            if isinstance(i, Event) and i.data.get("text")
        ]
        latest = reader.read_latest(0.5)
    assert texts == ["rate takes 1 to 500"]
    times = np.array([i.device_us for i in items])
    assert np.diff(times[5:]).mean() == pytest.approx(25_000, rel=0.01)
    assert {i.sample.led for i in items} == {True, False}
    assert len(latest.sample.sums) == 2


def test_doctor_tells_the_board_and_its_firmware(board):
    told = boards.ask(board("divider").port)
    assert told.startswith("firmware 1.0 (protocol 1), ")
    assert "the microcontroller's converter" in told


def test_a_board_that_cannot_do_what_is_asked(board):
    running = board("divider")
    reader = Reader(partial(open_port, running.port), "board", ReadoutSettings(channels=16))
    with raises(CaptureError, "board-command-refused"):
        reader.start()


def test_no_converter_answers(board):
    running = board("ads1115")
    with raises(CaptureError, "converter-not-found"):
        Reader(partial(open_port, running.port), "board").start()


@pytest.mark.slow
def test_a_chip_that_falls_silent_is_not_read(board):
    running = board("ads1115", "--ads", "2", "--stop-chip", "3")
    with Reader(partial(open_port, running.port), "board", ReadoutSettings(channels=8)) as reader:
        last, end = np.zeros(8), time.monotonic() + 30  # a busy machine's board is behind its time
        while not np.isnan(last[:4]).all() and time.monotonic() < end:
            found = [i.sample.counts for i in collect(reader, 0.5) if isinstance(i, StampedSample)]
            last = found[-1] if found else last
    assert np.isnan(last[:4]).all()
    assert np.isfinite(last[4:]).all()


@pytest.mark.slow
def test_unplugged_and_plugged_in_again(board, tmp_path):
    """The port goes away and comes back by its name; samples go on and the gap is marked."""
    link = tmp_path / "port"
    first = board("divider")
    link.symlink_to(first.port)
    with Reader(partial(open_port, str(link)), "board", ReadoutSettings(channels=3)) as reader:
        before = collect(reader, 1)
        first.stop()
        time.sleep(0.5)
        second = board("divider")
        link.unlink()
        link.symlink_to(second.port)
        after = collect(reader, 3)
        statistics = reader.statistics
    kinds = [
        i.kind for i in before + after if isinstance(i, Event) and i.kind not in ("info", "text")
    ]
    assert kinds[:2] == ["start", "gap"]
    assert "resumed" in kinds
    assert statistics.gaps == 1
    times = [i.device_us for i in before + after if isinstance(i, StampedSample)]
    assert (np.diff(times) > 0).all()
    assert isinstance(after[-1], StampedSample)
