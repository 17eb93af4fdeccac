"""Run numerical work in a child process: named arrays in, named arrays out.

Native code that runs for minutes could neither be stopped nor report progress in this process, and
may end the one that it runs in.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ....core.errors import MeshingError
from ....core.machine.child_process import (
    OUT_OF_MEMORY,
    ChildFailure,
    ChildLimits,
    run_module,
    start_child,
)

_TASK, _RESULT, _UNFINISHED = "task.npz", "result.npz", "unfinished.npz"
#: Work that takes this many times as long as usual gets advice displayed.
SLOW_RATIO = 3.0


@dataclass(frozen=True)
class RunMonitor:
    """Time limit and progress of all runs of one meshing method.

    Attributes:
        limit: Time limit of all runs together, s.
        report: Called with progress messages.
        description: What is running.
        usual_duration: Duration on an idle machine, s.
        fallback: What is done if it fails.
        started_at: Start on the monotonic clock, s.
    """

    limit: float
    report: Callable[[str], None]
    description: str
    usual_duration: float
    fallback: str
    started_at: float = field(default_factory=time.monotonic)

    def time_left(self) -> float:
        """Return the rest of the limit, s.

        Raises:
            MeshingError: If no time is left.
        """
        left = self.limit - (time.monotonic() - self.started_at)
        if left <= 0:
            raise MeshingError(
                f"did not end within {round(self.limit, 2):g} s, or did not start",
                code="time-limit-exceeded",
                where="the mesher",
                limit=self.limit,
            )
        return left

    def report_waiting(self) -> None:
        """Report that the run continues."""
        seconds = time.monotonic() - self.started_at
        text = f"{self.description}: {seconds:.0f} s, usually {self.usual_duration:.0f} s"
        if seconds > SLOW_RATIO * self.usual_duration:
            text += (
                f"; stopped after {self.limit:.0f} s, then {self.fallback}; a larger [mesh]"
                " edge_length or a surface of fewer triangles is faster"
            )
        self.report(text)


def run_work(
    module: str, subject: str, task: Mapping[str, Any], monitor: RunMonitor
) -> dict[str, Any]:
    """Run `python -m module FOLDER`, which calls `serve_work`, and return its result.

    Args:
        module: Dotted name of the module.
        subject: Noun phrase for the work in messages.
        task: Arrays and numbers for the work.
        monitor: Time limit and progress.

    Returns:
        The arrays of the result.

    Raises:
        MemoryError: If the work runs out of memory.
        MeshingError: If it fails or takes too long.
    """

    def write_task(folder: Path) -> None:
        np.savez(folder / _TASK, **task)

    failure = ChildFailure(MeshingError, "", subject)
    with (
        run_module(
            module,
            write_task,
            _RESULT,
            ChildLimits(monitor.time_left()),
            failure,
            on_wait=monitor.report_waiting,
        ) as folder,
        np.load(folder / _RESULT) as arrays,
    ):
        result = dict(arrays)
    raise_child_error(result, subject)
    return result


def raise_child_error(result: Mapping[str, Any], subject: str) -> None:
    """Raise the error in a child's result, if there is one.

    Args:
        result: Arrays that the child process wrote.
        subject: Noun phrase for the work, for the message.

    Raises:
        MemoryError: If the child ran out of memory.
        MeshingError: For other errors.
    """
    if "error" in result:
        text = str(result["error"])
        if text == OUT_OF_MEMORY:
            raise MemoryError
        raise MeshingError(f"{subject} failed: {text}", code="mesher-failed")


def serve_work(folder: str, work: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Do the work of the task in `folder`, and write the result or the error there."""
    start_child()
    os.chdir(folder)  # native code may leave files there
    with np.load(_TASK) as task:
        data = dict(task)
    try:
        result = work(data)
    except MemoryError:
        result = {"error": OUT_OF_MEMORY}
    except (MeshingError, RuntimeError, ValueError) as error:
        result = {"error": " ".join(str(error).split()) or type(error).__name__}
    np.savez(_UNFINISHED, **result)
    Path(_UNFINISHED).replace(_RESULT)
