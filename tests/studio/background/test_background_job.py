"""A background job reports progress, and can be paused and canceled."""

from __future__ import annotations

import threading

import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.studio.background.background_job import (
    CANCELLED,
    PAUSE,
    RESUME,
    BackgroundJob,
    JobReporter,
)
from defsense_fab.studio.background.build_job import BuildProgress, run_build

TIMEOUT_S = 600.0


class Pipe:
    """The child process's end of a pipe, with messages that have arrived."""

    def __init__(self, *orders):
        self.orders, self.sent = list(orders), []

    def poll(self):
        return bool(self.orders)

    def recv(self):
        if not self.orders:
            raise EOFError
        return self.orders.pop(0)

    def send(self, report):
        self.sent.append(report)


def test_reports_wait_while_the_job_is_paused():
    pipe = Pipe(PAUSE, PAUSE, RESUME)
    JobReporter(pipe).progress(0.5, "half")
    assert pipe.sent == [("paused", True), ("paused", False), ("progress", (0.5, "half"))]
    JobReporter(pipe).item(3)
    assert pipe.sent[-1] == ("item", 3)


def test_a_paused_job_ends_if_the_studio_is_gone():
    with pytest.raises(EOFError):
        JobReporter(Pipe(PAUSE)).progress(0.5, "half")


def test_the_progress_of_stages_does_not_decrease():
    pipe = Pipe()
    reporter = JobReporter(pipe)
    for stage, share in (("process", 0.5), ("process", 1.0), ("train", 0.0), ("train", 1.0)):
        reporter.stage_progress(stage, share, "at work")
    shares = [share for _, (share, _) in pipe.sent]
    assert shares == sorted(shares)
    assert 0 < shares[0] < shares[-1] < 1
    assert pipe.sent[-1][1][1] == "train: at work"


def test_the_progress_of_a_build_counts_all_of_its_stages_and_names_them():
    progress = BuildProgress({"simulate": "simulate the poses", "optimize": "optimize the layout"})
    reports = [
        progress.report(*report)
        for report in (
            ("body", 1.0, "done"),
            ("simulate", 0.5, "3 of 6"),
            ("simulate", 1.0, "done"),
            ("optimize", 0.0, "optimize the layout"),
            ("optimize", 0.9, "making layout 4 on trial"),
            ("optimize", 0.3, "stiffness"),
            ("optimize", 1.0, "done"),
        )
    ]
    shares = [share for share, _ in reports]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert 0 < shares[1] < shares[2] == shares[3] < 0.5
    assert reports[1][1] == "Stage 1 of 2, simulate the poses: 3 of 6"
    assert reports[3][1] == "Stage 2 of 2, optimize the layout"


def count(reporter, limit):
    for k in range(limit):
        reporter.item(k)
    if limit == 3:
        raise StorageError("three is too few", code="too-few", limit=limit)
    return "counted"


def run(job, *arguments):
    """Return the items, the errors and the results of a job."""
    items, outcomes = [], []
    background = BackgroundJob(
        "count", lambda *_: None, lambda *outcome: outcomes.append(outcome), items.append
    )
    assert background.state == "idle"
    assert background.start(job, *arguments)
    assert background.state == "running"
    assert background.wait(TIMEOUT_S)
    assert background.state == "idle"
    ((error, result),) = outcomes
    return items, error, result


@pytest.mark.slow
def test_items_results_and_errors_arrive():
    assert run(count, 2) == ([0, 1], None, "counted")
    items, error, result = run(count, 3)
    assert (items, result) == ([0, 1, 2], None)
    assert (type(error), error.code, error.data) == (StorageError, "too-few", {"limit": 3})
    items, error, _ = run(count, "x")
    assert (items, error.code) == ([], "job-failed")


@pytest.mark.slow
def test_a_job_is_paused_resumed_and_cancelled():
    paused, more, items, errors = threading.Event(), threading.Event(), [], []

    def on_item(k):
        items.append(k)
        if paused.is_set():
            more.set()

    job = BackgroundJob(
        "count",
        lambda *_: None,
        lambda error, _: errors.append(error),
        on_item,
        lambda is_paused: paused.set() if is_paused else None,
    )
    assert job.start(count, 10**9)
    assert not job.start(count, 1)
    job.pause()
    assert paused.wait(TIMEOUT_S)
    assert job.state == "paused"
    before = len(items)
    assert not more.wait(0.5)
    assert len(items) == before
    job.resume()
    assert more.wait(TIMEOUT_S)
    assert job.state == "running"
    job.cancel()
    assert job.wait(TIMEOUT_S)
    assert [e.code for e in errors] == [CANCELLED]


@pytest.mark.slow
def test_a_build_that_fails_and_one_that_is_cancelled_leave_the_studio_running(tmp_path):
    errors = []
    job = BackgroundJob("build", lambda *_: None, lambda error, _: errors.append(error))
    assert job.start(run_build, tmp_path / "nothing", "report")
    assert not job.start(run_build, tmp_path / "nothing", "report")
    assert job.wait(TIMEOUT_S)
    assert job.start(run_build, tmp_path / "nothing", "report")
    job.cancel()
    assert job.wait(TIMEOUT_S)
    assert [e.code for e in errors] == ["file-not-found", CANCELLED]
    assert not job.is_running
