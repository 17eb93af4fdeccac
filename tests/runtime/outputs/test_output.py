"""A loop that sends to outputs which are slow, raise, or cannot be opened."""

import logging
import threading

import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.outputs import output as output_module
from defsense_fab.runtime.outputs.output import LatestFrameSender
from tests.runtime.live_frames import frame, wait_for


class Recorder:
    """An output that keeps what it gets, and waits or raises where it is told to."""

    name, about, trouble = "recorder", "recorder: keeps frames", None

    def __init__(self):
        self.got, self.closed = [], False
        self.gate = threading.Event()
        self.gate.set()
        self.errors = []
        self.entered = threading.Event()

    def send(self, one):
        self.entered.set()
        self.gate.wait(20)
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
    made = LatestFrameSender("recorder", lambda: recorder)
    yield made
    made.close()
    assert recorder.closed


def test_the_newest_wins(recorder, output):
    """While an output is held up, only the last of what came meanwhile waits."""
    recorder.gate.clear()
    output.send(frame(0))
    assert recorder.entered.wait(20)
    for n in range(1, 100):
        output.send(frame(n))
    assert output.statistics.given == 100
    assert output.statistics.dropped == 98
    recorder.gate.set()
    assert wait_for(lambda: output.statistics.sent == 2)
    assert recorder.got == [0, 99]
    assert output.statistics.dropped == 98


def test_an_output_that_is_held_up_is_told(recorder, output, monkeypatch):
    monkeypatch.setattr(output_module, "_HELD_UP", 0.05)
    recorder.gate.clear()
    output.send(frame(0))
    assert wait_for(lambda: output.trouble is not None)
    assert "recorder: one frame has taken 0 s so far" in output.trouble
    recorder.gate.set()
    assert wait_for(lambda: output.trouble is None)


def test_an_output_that_raises_is_told_and_tried_again(recorder, output, caplog):
    recorder.errors = [OSError("cable\npulled"), OutputError("recorder: full; empty it")]
    output.send(frame(1))
    assert wait_for(lambda: output.trouble == "recorder: cable pulled")
    output.send(frame(2))
    assert wait_for(lambda: output.trouble == "recorder: full; empty it")
    output.send(frame(3))
    assert wait_for(lambda: output.statistics.sent == 1)
    assert output.trouble is None
    assert recorder.got == [3]
    assert output.statistics.failures == 2
    assert output.statistics.dropped == 2
    assert [r.levelno for r in caplog.records] == [logging.WARNING] * 2


def test_an_output_that_cannot_be_opened_at_first(recorder):
    ways = [OutputError("recorder: port taken"), OSError("gone")]

    def opener():
        if ways:
            raise ways.pop(0)
        return recorder

    output = LatestFrameSender("recorder", opener)
    assert output.wait_until_tried(20)
    assert output.about == "recorder: is not open" or not ways
    assert wait_for(lambda: output.trouble is None and not ways)
    output.send(frame(5))
    assert wait_for(lambda: recorder.got == [5])
    assert output.about == "recorder: keeps frames"
    output.close()
    assert recorder.closed


def test_closing_while_it_is_in_trouble():
    def opener():
        raise OutputError("never")

    output = LatestFrameSender("x", opener)
    assert wait_for(lambda: output.trouble == "never")
    output.close()
    assert output.trouble == "never"
    assert output.statistics.sent == 0


def test_a_limit_of_the_rate(recorder):
    output = LatestFrameSender("recorder", lambda: recorder, rate=1)
    for n in range(20):
        output.send(frame(n))
        threading.Event().wait(0.005)
    output.close()
    assert len(recorder.got) < 20
    assert output.statistics.given == 20


def test_what_fails_while_it_closes_is_logged(recorder, caplog):
    def close():
        recorder.closed = True
        raise OSError("too late")

    recorder.close = close
    output = LatestFrameSender("recorder", lambda: recorder)
    assert output.wait_until_tried(20)
    output.close()
    assert "could not be closed: too late" in caplog.text


def test_what_an_output_does_now_is_news_where_it_did_something_else(monkeypatch):
    changed = Recorder()
    output = LatestFrameSender("recorder", lambda: changed)
    assert output.wait_until_tried(5.0)
    assert output.news is None
    changed.about = "recorder: keeps every second frame"
    assert output.news == "recorder: keeps every second frame"
    monkeypatch.setattr(output_module, "_NEWS", 0.0)
    assert output.news is None
    output.close()
