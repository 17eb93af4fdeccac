"""One job runs at a time; a job that gives way ends when another one starts."""

import time

import pytest

from defsense_fab.core.errors import DefsenseError
from defsense_fab.studio.background.background_job import CANCELLED
from defsense_fab.studio.session.job_strip import JobStrip, Work
from tests.support.errors import raises

TIMEOUT_S = 60.0


@pytest.fixture
def strip():
    shares = []
    strip = JobStrip(lambda event: shares.append(event.share))
    strip.shares = shares
    yield strip
    strip.close()


def test_a_job_that_gives_way_is_canceled_by_the_next_one(strip):
    ends = []
    quiet = Work(
        name="body", title="Make the body", job=sleep, arguments=(TIMEOUT_S,),
        on_end=lambda error, _: ends.append(error.code), gives_way=True,
    )  # fmt: skip
    strip.start(quiet)
    strip.check_idle()
    strip.start(Work(name="build", title="Build", job=sleep, arguments=(TIMEOUT_S,)))
    assert ends == [CANCELLED]
    assert strip.job.name == "build"
    with raises(DefsenseError, "job-running"):
        strip.check_idle()
    with raises(DefsenseError, "job-running"):
        strip.start(quiet)


def test_the_problem_of_the_last_job_is_forgotten(strip):
    strip.start(Work(name="build", title="Build", job=fail))
    assert strip.wait(TIMEOUT_S)
    assert strip.job.problem.code == "broken"
    strip.forget_problem()
    assert strip.job.problem is None


def fail(_):
    raise DefsenseError("it is broken", code="broken")


def sleep(_, seconds):
    time.sleep(seconds)


def test_the_bar_of_a_job_does_not_go_back(strip):
    strip.start(Work(name="build", title="Build", job=report_back))
    assert strip.wait(TIMEOUT_S)
    assert strip.shares == sorted(strip.shares)


def report_back(reporter):
    for share in (0.2, 0.7, 0.3):
        reporter.progress(share, "at work")
