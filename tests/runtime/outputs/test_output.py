"""A slow, failing or closed output never blocks the loop that sends to it."""

import logging
import threading

import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.outputs import output as output_module
from defsense_fab.runtime.outputs.output import LatestFrameSender
from tests.runtime.live_frames import frame, wait_for


class Recorder:
    """An output that keeps its frames, and waits or raises on request."""

    name, about, trouble = "recorder", "recorder: keeps frames", None

    def __init__(self):
        self.got, self.closed = [], False
        self.gate = threading.Event()
        self.gate.set()
        self.errors = []
        self.entered = threading.Event()

    def send(self, one):
        self.entered.set()
        self.gate.wait(120)
        if self.errors:
            raise self.errors.pop(0)
        self.got.append(one.number)

    def close(self):
        self.closed = True


@pytest.fixture
def recorder():
    return Recorder()


@pytest.fixture
def output(recorder):
    sender = LatestFrameSender("recorder", lambda: recorder)
    yield sender
    sender.close()
    assert recorder.closed


def test_only_the_latest_frame_waits(recorder, output):
    """While an output is busy, all frames but the last are dropped."""
    recorder.gate.clear()
    output.send(frame(0))
    assert recorder.entered.wait(120)
    for n in range(1, 100):
        output.send(frame(n))
    assert output.statistics.received == 100
    assert output.statistics.dropped == 98
    recorder.gate.set()
    assert wait_for(lambda: output.statistics.sent == 2)
    assert recorder.got == [0, 99]
    assert output.statistics.dropped == 98


def test_slow_send_is_reported(recorder, output, monkeypatch):
    monkeypatch.setattr(output_module, "_MAX_SEND_S", 0.05)
    recorder.gate.clear()
    output.send(frame(0))
    assert wait_for(lambda: output.trouble is not None)
    assert output.trouble.code == "send-slow"
    recorder.gate.set()
    assert wait_for(lambda: output.trouble is None)


def test_failing_output_is_reported_and_tried_again(recorder, output, caplog):
    recorder.errors = [
        OSError("cable\npulled"),
        OutputError("recorder: full; empty it", code="test-failure"),
    ]
    output.send(frame(1))
    assert wait_for(lambda: str(output.trouble) == "recorder: cable pulled")
    output.send(frame(2))
    assert wait_for(lambda: str(output.trouble) == "recorder: full; empty it")
    output.send(frame(3))
    assert wait_for(lambda: output.statistics.sent == 1)
    assert output.trouble is None
    assert recorder.got == [3]
    assert output.statistics.failures == 2
    assert output.statistics.dropped == 2
    assert [r.levelno for r in caplog.records] == [logging.WARNING] * 2


def test_opening_is_tried_again(recorder):
    failures = [OutputError("recorder: port taken", code="test-failure"), OSError("gone")]

    def opener():
        if failures:
            raise failures.pop(0)
        return recorder

    output = LatestFrameSender("recorder", opener)
    assert output.wait_until_tried(20)
    assert not output.is_open or not failures
    assert wait_for(lambda: output.trouble is None and not failures)
    output.send(frame(5))
    assert wait_for(lambda: recorder.got == [5])
    assert output.about == recorder.about
    output.close()
    assert recorder.closed


def test_closing_a_failing_output():
    def opener():
        raise OutputError("never", code="test-failure")

    output = LatestFrameSender("x", opener)
    assert wait_for(lambda: str(output.trouble) == "never")
    output.close()
    assert str(output.trouble) == "never"
    assert output.statistics.sent == 0


def test_rate_is_limited(recorder):
    output = LatestFrameSender("recorder", lambda: recorder, rate=1)
    for n in range(20):
        output.send(frame(n))
        threading.Event().wait(0.005)
    output.close()
    assert len(recorder.got) < 20
    assert output.statistics.received == 20


def test_failure_to_close_is_logged(recorder, caplog):
    def close():
        recorder.closed = True
        raise OSError("too late")

    recorder.close = close
    output = LatestFrameSender("recorder", lambda: recorder)
    assert output.wait_until_tried(20)
    output.close()
    assert "too late" in caplog.text


def test_change_of_an_output_is_news(monkeypatch):
    changed = Recorder()
    output = LatestFrameSender("recorder", lambda: changed)
    assert output.wait_until_tried(5.0)
    assert output.news is None
    changed.about = "recorder: keeps every second frame"
    assert (output.news.code, output.news.text) == ("output-changed", changed.about)
    monkeypatch.setattr(output_module, "_NEWS_S", 0.0)
    assert output.news is None
    output.close()
