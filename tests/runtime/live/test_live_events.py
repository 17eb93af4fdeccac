"""Events of the read-out board while a device is live: silence, restart, another board."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from defsense_fab.capture.readout.source import Event, ReadoutStatistics, StampedSample
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
        self.full_scale, self.number, self.lost = 1024, 0, 0

    @property
    def statistics(self):
        return ReadoutStatistics(samples=self.number, lost=self.lost)

    def start(self):
        return Info(1, (1, 0), 0, 2, AVERAGES, 100, 0, 2, self.full_scale)

    def drain(self):
        return []

    def close(self):
        pass

    def send(self, ohms, age_s=0.0):
        counts = Dividers(REFERENCE, self.full_scale).counts(np.asarray(ohms))
        sums = tuple(round(float(AVERAGES * c)) for c in counts)
        self.number += 1
        micros = 10_000 * self.number
        sample = Sample(self.number, micros, False, False, AVERAGES, sums)
        self.sink(StampedSample(time.monotonic_ns() - round(1e9 * age_s), micros, sample))

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


def codes(loop):
    return [note.code for note in loop.status.notes]


@pytest.mark.parametrize(("period", "is_reported"), [(5, True), (200, False)])
def test_samples_that_are_lost_on_the_line_are_reported(fed, period, is_reported):
    """Of each `period` samples one is lost."""
    source, loop, _ = fed
    for k in range(1, 601):
        source.lost += k % period == 0
        source.send(R0)
    assert loop.status.lost == source.lost
    assert ("samples-lost" in codes(loop)) == is_reported
    if is_reported:
        note = next(n for n in loop.status.notes if n.code == "samples-lost")
        assert note.data["share"] == pytest.approx(1 / (period + 1), abs=0.01)


def test_samples_of_a_disconnected_board_are_not_lost_on_the_line(fed):
    source, loop, _ = fed
    for _ in range(100):
        source.send(R0)
    source.report("gap", why="unplugged")
    source.lost += 400  # the board kept counting
    source.report("resumed")
    for _ in range(50):
        source.send(R0)
    assert loop.status.lost == 400
    assert "samples-lost" not in codes(loop)


def test_samples_that_are_not_decoded_are_counted(fed, monkeypatch):
    source, loop, out = fed
    source.send(R0)
    out.until(lambda f: f.number == 1)
    decode, is_waiting, resume = loop.decoder, threading.Event(), threading.Event()

    def slow(reading):
        is_waiting.set()
        resume.wait(60)
        return decode(reading)

    slow.model, slow.has_rest = decode.model, decode.has_rest
    monkeypatch.setattr(loop, "decoder", slow)
    source.send(R0)
    assert is_waiting.wait(60)
    for k in range(80):
        source.send(R0, age_s=10.0 if k < 30 else 0.0)
    resume.set()
    out.until(lambda f: f.time >= 0.01 * source.number - 1e-6)
    status = loop.status
    assert (status.samples, status.skipped, status.lost) == (82, 30, 0)
