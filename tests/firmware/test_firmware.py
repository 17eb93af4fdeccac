"""Test the firmware on a simulated board, read by the host over a pseudo-terminal."""

import os
import subprocess
import time
from functools import partial

import numpy as np
import pytest

from defsense_fab.capture.readout.ports import open_port
from defsense_fab.capture.readout.reader import Reader, ReadoutSettings
from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.core.errors import CaptureError
from defsense_fab.workflow.doctor import hardware
from tests.firmware.build import FIRMWARE
from tests.firmware.conftest import collect
from tests.support.errors import raises

#: Simulated seconds of the long runs.
SECONDS = int(os.environ.get("DEFSENSE_FIRMWARE_SECONDS", "12"))


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
def test_samples_equal_the_conversions(board, sketch, settings, options):
    """No frame is bad, no sample lost, and every sum is that of the simulated conversions."""
    running = board(sketch, "--fast", "--seconds", SECONDS, *options)
    reader = Reader(partial(open_port, running.port), "board", settings)
    info = reader.start()
    items = []
    while not any(isinstance(i, Event) and i.kind == "gap" for i in items):
        items += collect(reader, 0.2)
    statistics = reader.statistics
    reader.close()
    running.wait(120)
    assert (info.channels, info.averages, info.rate) == (
        settings.channels, settings.average, settings.rate,
    )  # fmt: skip
    # Samples during the greeting have other settings. The rate is set last, so samples before the
    # first interval of its length have another rate; on a busy machine there are more of them.
    samples = [
        i.sample
        for i in items
        if isinstance(i, StampedSample)
        and (len(i.sample.sums), i.sample.averages) == (settings.channels, settings.average)
    ]
    steps = np.diff([s.micros for s in samples])
    begin = int(np.argmax(np.abs(steps - 1e6 / settings.rate) < 100))
    samples = samples[begin + 2 :]
    assert statistics.bad <= 1  # the frame that was cut when the reader started
    # The board does not wait for a slow host: time passes until it is greeted, and the last samples
    # are lost when it ends.
    assert len(samples) > 2 * settings.rate
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


def test_host_configures_the_board(board):
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


def test_doctor_describes_the_board_and_its_firmware(board):
    description = hardware.describe_board(board("divider").port)
    assert "1.0" in description
    assert "protocol 1" in description
    assert "microcontroller" in description


def test_unsupported_channel_count_is_refused(board):
    running = board("divider")
    reader = Reader(partial(open_port, running.port), "board", ReadoutSettings(channels=16))
    with raises(CaptureError, "board-command-refused"):
        reader.start()


def test_missing_converter_is_reported(board):
    running = board("ads1115")
    with raises(CaptureError, "converter-not-found"):
        Reader(partial(open_port, running.port), "board").start()


@pytest.mark.slow
def test_channels_of_a_silent_chip_are_nan(board):
    running = board("ads1115", "--ads", "2", "--stop-chip", "3")
    with Reader(partial(open_port, running.port), "board", ReadoutSettings(channels=8)) as reader:
        last, end = (
            np.zeros(8),
            time.monotonic() + 120,
        )  # the simulated board is slow on a busy machine
        while not np.isnan(last[:4]).all() and time.monotonic() < end:
            found = [i.sample.counts for i in collect(reader, 0.5) if isinstance(i, StampedSample)]
            last = found[-1] if found else last
    assert np.isnan(last[:4]).all()
    assert np.isfinite(last[4:]).all()


@pytest.mark.slow
def test_board_is_unplugged_and_plugged_in_again(board, tmp_path):
    """The port disappears and returns under its name; samples continue and the gap is marked."""
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
        after, end = [], time.monotonic() + 60
        while not any(i.kind == "resumed" for i in after if isinstance(i, Event)):
            assert time.monotonic() < end
            after += collect(reader, 0.2)
        after += collect(reader, 1)
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
