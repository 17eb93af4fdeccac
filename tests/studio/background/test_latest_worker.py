"""A worker handles the latest item."""

from __future__ import annotations

import operator
import threading

from defsense_fab.studio.background.latest_worker import LatestWorker

TIMEOUT_S = 600.0


def test_the_latest_item_is_handled_and_errors_are_reported():
    started, go, handled, errors = threading.Event(), threading.Event(), [], []

    def work(x):
        started.set()
        go.wait(TIMEOUT_S)
        if x < 0:
            raise ValueError(x)
        handled.append(x)

    worker = LatestWorker(work, errors.append)
    worker.give(1)
    assert started.wait(TIMEOUT_S)
    assert worker.is_busy
    for x in (2, 3, 4):
        worker.give(x)
    assert worker.pending == 4
    go.set()
    assert worker.wait(TIMEOUT_S)
    assert handled == [1, 4]
    worker.give(-1)
    assert worker.wait(TIMEOUT_S)
    assert [e.args for e in errors] == [(-1,)]
    assert worker.done_count == 3
    assert not worker.is_busy
    worker.close()
    worker.give(5)
    assert handled == [1, 4]


def test_merged_items_are_handled_after_the_delay():
    handled, done = [], threading.Event()

    def work(values):
        handled.append(values)
        done.set()

    worker = LatestWorker(work, handled.append, delay_s=0.05, merge=operator.or_)
    for value in range(5):
        worker.give({"a": value})
    worker.give({"b": 7})
    assert "a" in worker.pending
    assert done.wait(TIMEOUT_S)
    assert handled == [{"a": 4, "b": 7}]
    assert worker.pending is None
    worker.close()


def test_flush_handles_the_waiting_item_on_the_calling_thread():
    errors = []

    def work(values):
        raise ValueError(values, threading.current_thread())

    worker = LatestWorker(work, errors.append, delay_s=TIMEOUT_S)
    worker.give(1)
    worker.flush()
    worker.flush()
    worker.close()
    assert [e.args for e in errors] == [(1, threading.current_thread())]


def test_close_drops_the_waiting_item():
    handled = []
    worker = LatestWorker(handled.append, handled.append, delay_s=TIMEOUT_S)
    worker.give(1)
    worker.close()
    worker.flush()
    assert handled == []
    assert worker.wait(0)
