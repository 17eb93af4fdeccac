"""Limits of child processes: processor time, wall time and memory."""

from __future__ import annotations

import sys
import textwrap

import pytest

from defsense_fab.core.errors import BodyError
from defsense_fab.core.machine import child_process
from defsense_fab.core.machine.child_process import ChildFailure, ChildLimits, run_module
from defsense_fab.core.machine.processes import GroupUsage, group_usage
from tests.support.errors import raises

FAILURE = ChildFailure(BodyError, "body.stl", "reading it", "Write it again", "Simplify it")
START = """
import sys, time
from pathlib import Path
from defsense_fab.core.machine.child_process import start_child
start_child()
done = Path(sys.argv[1]) / "done"
"""


@pytest.fixture
def child(tmp_path, monkeypatch):
    """Return a function that runs Python text in a child process with limits."""
    monkeypatch.syspath_prepend(tmp_path)

    def run(text, limits, start=START):
        (tmp_path / "worker.py").write_text(start + textwrap.dedent(text))
        with run_module("worker", lambda _: None, "done", limits, FAILURE) as folder:
            return (folder / "done").read_text()

    return run


def test_a_child_that_waits_longer_than_its_processor_time_is_not_stopped(child):
    text = "time.sleep(2.5)\ndone.write_text('finished')"
    assert child(text, ChildLimits(wall=60, cpu=1.5)) == "finished"


def test_a_child_that_uses_its_processor_time_is_stopped(child):
    with raises(BodyError, "time-limit-exceeded", limit=1.0) as caught:
        child("while True: pass", ChildLimits(wall=60, cpu=1.0))
    assert caught.value.is_machine_limit


def test_processor_time_of_further_processes_counts(child):
    text = """
    import subprocess
    subprocess.run([sys.executable, "-c", "while True: pass"])
    """
    with raises(BodyError, "time-limit-exceeded", limit=1.0):
        child(text, ChildLimits(wall=60, cpu=1.0))


def test_a_child_that_only_waits_is_stopped_in_the_end(child):
    with raises(BodyError, "time-limit-exceeded", limit=0.5):
        child("time.sleep(60)", ChildLimits.of_cpu_time(0.5))


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the child itself")
def test_memory_beyond_the_limit_is_refused_in_the_child(child):
    text = """
    try:
        memory = bytearray(4 * 2**30)
    except MemoryError:
        done.write_text("refused")
    """
    assert child(text, ChildLimits(wall=60, memory=2 * 2**30)) == "refused"


def test_memory_is_measured_where_the_system_does_not_limit_it(child, monkeypatch):
    monkeypatch.setattr(child_process.sys, "platform", "darwin")
    text = "import time\nmemory = b'1' * (2 * 10**8)\ntime.sleep(60)"
    with raises(BodyError, "memory-limit-exceeded", limit=10**8) as caught:
        child(text, ChildLimits(wall=60, memory=10**8), start="")  # without its own limit
    assert caught.value.is_machine_limit


def test_a_process_that_has_ended_uses_nothing():
    assert group_usage(2**22 + 1) == GroupUsage(0.0, 0)
