"""What happens to the read-out board while a device is live: it falls silent, starts anew, is
another one."""

from __future__ import annotations

import time

import numpy as np
import pytest
from defsense_fab.runtime.live.live_device import live_device
from defsense_fab.runtime.live.live_loop import LiveLoop
from threadpoolctl import threadpool_info, threadpool_limits

from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.runtime.frames.live_decoder import LiveDecoder
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.sensing.serial_frames import Info, Sample
from defsense_fab.sensing.voltage_divider import Dividers
from tests.runtime.live.conftest import R0
from tests.runtime.live.test_live_loop import Kept

REFERENCE = np.array([1500.0, 1000.0])
AVERAGES = 64


class Fed:
    """A source that says what it is told to."""

    name, sink = "fed", None

    def __init__(self):
        self.full_scale, self.number = 1024, 0

    def start(self):
        return Info(1, (1, 0), 0, 2, AVERAGES, 100, 0, 2, self.full_scale)

    def drain(self):
        return []

    def close(self):
        pass

    def say(self, ohms):
        counts = Dividers(REFERENCE, self.full_scale).counts(np.asarray(ohms))
        sums = tuple(round(float(AVERAGES * c)) for c in counts)
        self.number += 1
        micros = 10_000 * self.number
        sample = Sample(self.number, micros, False, False, AVERAGES, sums)
        self.sink(StampedSample(time.monotonic_ns(), micros, sample))

    def happens(self, kind, **data):
        self.sink(Event(time.monotonic_ns(), kind, data))


@pytest.fixture
def fed(live_bar):
    device = live_device(live_bar.model)
    source, out = Fed(), Kept()
    loop = LiveLoop(source, LiveDecoder(device.model, R0), device.wired, REFERENCE, outputs=[out])
    loop.start()
    yield source, loop, out
    loop.close()


def test_a_board_that_falls_silent_is_told_to_outputs_too(fed):
    source, _, out = fed
    source.say(R0)
    out.until(lambda f: f.quality is Quality.TRUSTED)
    out.until(lambda f: f.quality is Quality.LOST)
    last = out.frames[-1]
    assert last.notes == ("fed: nothing comes from the read-out board",)
    assert last.number > out.frames[0].number
    source.say(R0)
    out.until(lambda f: f.quality is Quality.TRUSTED and f.number > last.number)


def test_a_board_with_another_range_is_read_by_that(fed):
    source, _, out = fed
    source.say(R0)
    out.until(lambda f: f.number == 1)
    source.full_scale = 4096
    source.happens("resumed", full_scale=4096, channels=2)
    source.say(1.02 * R0)
    out.until(lambda f: np.allclose(f.ohms, 1.02 * R0, rtol=2e-3))
    assert out.frames[-1].quality is not Quality.LOST


def test_what_happened_is_told_for_a_while(fed):
    source, loop, out = fed
    source.say(R0)
    source.happens("restart")
    source.say(R0)
    out.until(lambda f: f.number >= 2)
    assert "fed: the read-out board started anew" in loop.status.notes
    source.happens("gap", why="unplugged")
    assert any("is gone (unplugged); waiting" in note for note in loop.status.notes)


def test_linear_algebra_has_one_thread_while_a_device_is_live(live_bar):
    """Others would spin between samples."""
    device = live_device(live_bar.model)
    loop = LiveLoop(Fed(), LiveDecoder(device.model, R0), device.wired, REFERENCE)

    def threads():
        return {p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"}

    with threadpool_limits(2, "blas"):
        before = threads()
        loop.start()
        assert threads() == {1}
        loop.close()
        assert threads() == before
