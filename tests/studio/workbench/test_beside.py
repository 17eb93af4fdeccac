"""Work in a process of its own: it can be followed, paused and cancelled."""

from __future__ import annotations

import threading

import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.studio.workbench.beside import BesideWork, Teller

LONG = 120.0


class Pipe:
    """The other process' end, with orders that have come."""

    def __init__(self, *orders):
        self.orders, self.sent = list(orders), []

    def poll(self):
        return bool(self.orders)

    def recv(self):
        if not self.orders:
            raise EOFError
        return self.orders.pop(0)

    def send(self, thing):
        self.sent.append(thing)


def test_work_waits_where_it_is_told_to_and_goes_on():
    pipe = Pipe("wait", "wait", "go on")
    Teller(pipe).progress(0.5, "half")
    assert pipe.sent == [("paused", None), ("went on", None), ("progress", (0.5, "half"))]
    Teller(pipe).found(3)
    assert pipe.sent[-1] == ("found", 3)


def test_paused_work_ends_when_nobody_is_there_any_more():
    with pytest.raises(EOFError):
        Teller(Pipe("wait")).progress(0.5, "half")


def count(teller, most):
    for k in range(most):
        teller.found(k)
    if most == 3:
        raise StorageError("three is too few")


def run(work, *arguments):
    """What was found, and what came of it."""
    found, ended, over = [], [], threading.Event()
    beside = BesideWork("count", lambda *_: None, lambda p: (ended.append(p), over.set()),
                        found.append)  # fmt: skip
    assert beside.begin(work, *arguments)
    assert over.wait(LONG)
    assert not beside.running
    return found, ended


@pytest.mark.slow
def test_what_work_finds_is_heard_and_what_goes_wrong_is_told():
    assert run(count, 2) == ([0, 1], [None])
    assert run(count, 3) == ([0, 1, 2], ["three is too few"])
    found, (problem,) = run(count, "x")
    assert not found
    assert problem.startswith("the count failed (TypeError")


@pytest.mark.slow
def test_work_is_paused_in_the_middle_and_cancelled():
    stood, ended, found = threading.Event(), threading.Event(), []
    more = threading.Event()

    def heard(k):
        found.append(k)
        if stood.is_set():
            more.set()

    outcome = []
    beside = BesideWork(
        "count", lambda *_: None, lambda p: (outcome.append(p), ended.set()), heard,
        lambda stands: stood.set() if stands else None,
    )  # fmt: skip
    assert beside.begin(count, 10**9)
    assert not beside.begin(count, 1)
    beside.pause()
    assert stood.wait(LONG)
    before = len(found)
    assert not more.wait(0.5)
    assert len(found) == before
    beside.go_on()
    assert more.wait(LONG)
    beside.cancel()
    assert ended.wait(LONG)
    assert outcome == ["cancelled"]
