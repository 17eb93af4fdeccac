"""Recordings that play again."""

from __future__ import annotations

import time
from itertools import pairwise

from defsense_fab.capture.readout.recording import Recorder, Replay
from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.sensing.serial_frames import Sample

ABOUT = {
    "protocol": 1, "version": [1, 0], "converter": 0, "channels": 1, "averages": 4, "rate": 100,
    "led_period": 0, "most_channels": 1, "full_scale": 1024,
}  # fmt: skip


def record(path, host_s, count, device_us):
    with Recorder(path, 1) as recorder:
        begin = round(host_s * 1e9)
        recorder.add(Event(begin, "start", ABOUT))
        for k in range(count):
            sample = Sample(k, (device_us + 10_000 * k) % (1 << 32), False, False, 4, (2000 + k,))
            recorder.add(StampedSample(begin + 10_000_000 * k, device_us + 10_000 * k, sample))


def test_runs_in_one_file_are_joined_within_a_second(tmp_path):
    """The second was hours later, on another day's clock, and the board's began anew."""
    path = tmp_path / "board.csv"
    record(path, 50_000.0, 20, 7_000_000)
    record(path, 120.0, 20, 300)
    replay, got = Replay(path, speed=20.0), []
    replay.start()
    end = time.monotonic() + 30
    while len(got) < 40 and time.monotonic() < end:
        got += [s for s in replay.drain() if isinstance(s, StampedSample)]
    assert len(got) == 40
    micros = [s.device_us for s in got]
    assert micros[0] == 7_000_000
    steps = [b - a for a, b in pairwise(micros)]
    assert steps == [10_000] * 19 + [1_000_000] + [10_000] * 19
    assert [s.sample.sums[0] for s in got] == [*range(2000, 2020)] * 2
