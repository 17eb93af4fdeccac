"""Tasks of several processes: results, lost processes, errors and cancellation."""

import os
import time
from pathlib import Path

import psutil
import pytest

from defsense_fab.core.machine.parallel_tasks import map_in_processes

TIMEOUT_S = 30.0


def wait_until(condition):
    end = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def square_after_start(task, folder):
    """Return the square and the process, once the other process has started, too."""
    (Path(folder) / str(os.getpid())).touch()
    wait_until(lambda: len(list(Path(folder).iterdir())) == 2)
    return task**2, os.getpid()


def end_process(task, folder):
    (Path(folder) / "started").touch()
    os._exit(1)


def wait_forever(task, folder):
    (Path(folder) / "started").touch()
    time.sleep(1000)


@pytest.mark.parametrize("processes", [1, 2])
def test_all_tasks_are_done_by_all_processes(processes, tmp_path):
    if processes == 1:
        (tmp_path / "other").touch()
    results = dict(map_in_processes(square_after_start, [1, 2, 3, 4], str(tmp_path), processes))
    assert {i: square for i, (square, _) in results.items()} == {0: 1, 1: 4, 2: 9, 3: 16}
    assert len({pid for _, pid in results.values()}) == processes


def test_tasks_of_a_lost_process_are_done_here(tmp_path):
    def call_here(i):
        wait_until((tmp_path / "started").exists)
        return -i

    results = dict(map_in_processes(end_process, range(3), str(tmp_path), 2, call_here))
    assert results == {0: 0, 1: -1, 2: -2}


def test_a_cancelled_map_leaves_no_process(tmp_path):
    before = set(psutil.Process().children(recursive=True))

    def call_here(_):
        wait_until((tmp_path / "started").exists)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(map_in_processes(wait_forever, range(3), str(tmp_path), 2, call_here))
    assert set(psutil.Process().children(recursive=True)) <= before
