"""Work beside the page: on the newest of what comes, and builds."""

from __future__ import annotations

import threading

import pytest

from defsense_fab.studio.workbench.build_work import BuildWork
from defsense_fab.studio.workbench.latest import Latest

LONG = 60.0


def test_the_newest_is_worked_on_and_failures_are_told():
    begun, go, seen, failed = threading.Event(), threading.Event(), [], []

    def work(x):
        begun.set()
        go.wait(LONG)
        if x < 0:
            raise ValueError(x)
        seen.append(x)

    latest = Latest(work, failed.append)
    latest.give(1)
    assert begun.wait(LONG)
    for x in (2, 3, 4):
        latest.give(x)
    go.set()
    assert latest.wait(LONG)
    assert seen == [1, 4]
    latest.give(-1)
    assert latest.wait(LONG)
    assert [str(e) for e in failed] == ["-1"]
    latest.close()


@pytest.mark.slow
def test_a_build_that_fails_and_one_that_is_cancelled_leave_the_page_alive(tmp_path):
    told, ended, over = [], [], threading.Event()

    def end(problem):
        ended.append(problem)
        over.set()

    work = BuildWork(lambda share, said: told.append(said), end)
    assert work.start(tmp_path / "nothing")
    assert not work.start(tmp_path / "nothing")
    assert over.wait(LONG)
    assert "no such file" in ended[0]
    over.clear()
    assert work.start(tmp_path / "nothing")
    work.cancel()
    assert over.wait(LONG)
    assert ended[1] == "cancelled"
    assert not work.running
