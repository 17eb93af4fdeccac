"""Call a function for several tasks in this process and in child processes at the same time.

This is for work that holds the interpreter's lock, which threads cannot share. The child processes
are started as `python -m defsense_fab.core.machine.parallel_tasks FOLDER`, so scripts need no guard
as with `multiprocessing`. They end with this process, and within seconds after an interruption.
"""

from __future__ import annotations

import math
import pickle
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..errors import DefsenseError
from .child_process import ChildFailure, ChildLimits, run_module, start_child

#: Files: what to do, in the folder of all processes; its path and the end, in that of a child.
_WORK, _QUEUE, _DONE = "work.pickle", "queue", "done"
_POLL_INTERVAL_S = 0.05
_FAILURE = ChildFailure(DefsenseError, "", "a process for searches")


class _Stopped(Exception):
    """The tasks were cancelled."""


def map_in_processes(
    function: Callable[[Any, Any], Any],
    tasks: Sequence[Any],
    shared: Any,
    processes: int,
    call_here: Callable[[int], Any] | None = None,
) -> Generator[tuple[int, Any], None, None]:
    """Call a function for each task, in this process and in others.

    Tasks of a process that ends unexpectedly, for example for lack of memory, or whose function
    raises an error there, are done in this process.

    Args:
        function: Function of a task and `shared`, in a module of this package.
        tasks: The tasks.
        shared: Data that all tasks need.
        processes: Number of processes, this one included.
        call_here: Called in this process instead of `function`, with the number of the task.

    Yields:
        Index and result of each finished task, in the order of completion.
    """
    call_here = call_here or (lambda i: function(tasks[i], shared))
    children = min(processes, len(tasks)) - 1
    if children < 1:
        for i in range(len(tasks)):
            yield i, call_here(i)
        return
    stop = threading.Event()
    with (
        tempfile.TemporaryDirectory(prefix="defsense-", ignore_cleanup_errors=True) as name,
        ThreadPoolExecutor(children, thread_name_prefix="tasks") as pool,
    ):
        queue = Path(name)
        (queue / _WORK).write_bytes(pickle.dumps((function, tasks, shared)))
        futures = [pool.submit(_run_child, queue, stop.is_set) for _ in range(children)]
        try:
            yield from _work_here(queue, len(tasks), call_here, futures)
        finally:
            stop.set()


def _work_here(
    queue: Path, count: int, call_here: Callable[[int], Any], children: Sequence[Future[None]]
) -> Iterator[tuple[int, Any]]:
    """Do tasks in this process until all are done, and yield all results."""
    missing = list(range(count))
    while missing:
        have_ended = all(child.done() for child in children)
        for i in [i for i in missing if (queue / f"{i}.result").exists()]:
            missing.remove(i)
            yield i, _load(queue / f"{i}.result")
        mine = next((i for i in missing if have_ended or _claim(queue, i)), None)
        if mine is not None:
            missing.remove(mine)
            yield mine, call_here(mine)
        elif missing:
            time.sleep(_POLL_INTERVAL_S)


def _load(path: Path) -> Any:
    return pickle.loads(path.read_bytes())  # noqa: S301 - written by one of these processes


def _claim(queue: Path, task: int) -> bool:
    """Return whether this process is the first to claim a task."""
    try:
        (queue / f"{task}.claim").touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _run_child(queue: Path, is_stopped: Callable[[], bool]) -> None:
    def write_queue(folder: Path) -> None:
        (folder / _QUEUE).write_text(str(queue), encoding="utf-8")

    def check() -> None:
        if is_stopped():
            raise _Stopped

    # Where it fails, this process does its tasks, and raises their errors.
    with (
        suppress(DefsenseError, _Stopped),
        run_module(__name__, write_queue, _DONE, ChildLimits(math.inf), _FAILURE, on_wait=check),
    ):
        pass


def main(folder: Path) -> None:
    """Do tasks of the queue until none is left."""
    start_child()
    queue = Path((folder / _QUEUE).read_text(encoding="utf-8"))
    function, tasks, shared = _load(queue / _WORK)
    for i, task in enumerate(tasks):
        if _claim(queue, i):
            part = queue / f"{i}.part"
            part.write_bytes(pickle.dumps(function(task, shared)))
            part.replace(queue / f"{i}.result")
    (folder / _DONE).touch()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
