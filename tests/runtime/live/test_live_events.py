"""Events of the read-out board while a device is live: silence, restart, another board."""

from __future__ import annotations

import time

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.runtime.frames.live_decoder import LiveDecoder
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.live.live_loop import LiveLoop, Receivers
from defsense_fab.sensing.serial_frames import Info, Sample
from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.workflow.run.live_device import live_device
from tests.runtime.live.conftest import R0
from tests.runtime.live.test_live_loop import Kept

REFERENCE = np.array([1500.0, 1000.0])
AVERAGES = 64


class ManualSource:
    """A source whose samples and events the test sends."""

    name, sink = "fed", None

    def __init__(self):
        self.full_scale, self.number = 1024, 0

    def start(self):
        return Info(1, (1, 0), 0, 2, AVERAGES, 100, 0, 2, self.full_scale)

    def drain(self):
        return []

    def close(self):
        pass

    def send(self, ohms):
        counts = Dividers(REFERENCE, self.full_scale).counts(np.asarray(ohms))
        sums = tuple(round(float(AVERAGES * c)) for c in counts)
        self.number += 1
        micros = 10_000 * self.number
        sample = Sample(self.number, micros, False, False, AVERAGES, sums)
        self.sink(StampedSample(time.monotonic_ns(), micros, sample))

    def report(self, kind, **data):
        self.sink(Event(time.monotonic_ns(), kind, data))


@pytest.fixture
def fed(live_bar):
    device = live_device(live_bar.model)
    source, out = ManualSource(), Kept()
    loop = LiveLoop(
        source,
        LiveDecoder(device.model, R0),
        device.board_channels,
        REFERENCE,
        receivers=Receivers([out]),
    )
    loop.start()
    yield source, loop, out
    loop.close()


def test_silent_board_is_reported_to_outputs(fed):
    source, _, out = fed
    source.send(R0)
    out.until(lambda f: f.quality is Quality.TRUSTED)
    out.until(lambda f: f.quality is Quality.LOST)
    last = out.frames[-1]
    assert [note.code for note in last.notes] == ["board-silent"]
    assert last.number > out.frames[0].number
    source.send(R0)
    out.until(lambda f: f.quality is Quality.TRUSTED and f.number > last.number)


def test_board_with_another_range(fed):
    source, _, out = fed
    source.send(R0)
    out.until(lambda f: f.number == 1)
    source.full_scale = 4096
    source.report("resumed", full_scale=4096, channels=2)
    source.send(1.02 * R0)
    out.until(lambda f: np.allclose(f.ohms, 1.02 * R0, rtol=2e-3))
    assert out.frames[-1].quality is not Quality.LOST


def test_events_are_reported(fed):
    source, loop, out = fed
    source.send(R0)
    source.report("restart")
    source.send(R0)
    out.until(lambda f: f.number >= 2)
    assert "board-restarted" in [note.code for note in loop.status.notes]
    source.report("gap", why="unplugged")
    notes = {note.code: note.data for note in loop.status.notes}
    assert notes["board-disconnected"] == {"reason": "unplugged"}


def test_linear_algebra_has_one_thread_during_a_run(live_bar):
    """Further threads would spin between samples."""
    device = live_device(live_bar.model)
    loop = LiveLoop(ManualSource(), LiveDecoder(device.model, R0), device.board_channels, REFERENCE)

    def threads():
        return {p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"}

    with threadpool_limits(2, "blas"):
        before = threads()
        loop.start()
        assert threads() == {1}
        loop.close()
        assert threads() == before
