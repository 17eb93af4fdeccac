"""Processes and their threads, where systems differ: ending, limits, and resource use.

The branches compare `sys.platform` so that mypy checks each system's own code.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

#: Arguments of `subprocess.Popen` for a process group that Ctrl-C does not reach, and that
#: `kill_group` ends.
if sys.platform == "win32":
    NEW_GROUP: dict[str, Any] = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
else:
    NEW_GROUP: dict[str, Any] = {"start_new_session": True}


def kill_group(pid: int) -> None:
    """End a process that was started with `NEW_GROUP`, and all processes that it started.

    On Windows, children of a process that has already ended cannot be found.

    Args:
        pid: Number of the process.
    """
    if sys.platform == "win32":
        subprocess.run(["taskkill", "/F", "/T", "/PID", str(pid)], check=False, capture_output=True)
        return
    try:
        os.killpg(pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):  # it has ended; macOS refuses for a zombie
        return


def kill_own_group() -> None:
    """End this process, which was started with `NEW_GROUP`, and all that it started."""
    if sys.platform != "win32":
        os.killpg(0, signal.SIGKILL)
    kill_group(os.getpid())


def was_killed(code: int) -> bool:
    """Return whether an exit code means that the system killed a process, as for lack of memory."""
    return sys.platform != "win32" and -code == signal.SIGKILL


def limit_memory(size: int) -> None:
    """Limit the memory of this process where the system can.

    Windows cannot, and macOS refuses limits of the address space.

    Args:
        size: Limit, bytes.
    """
    if sys.platform == "win32":
        return
    import resource

    try:
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
    except (ValueError, OSError):
        if sys.platform == "linux":
            raise


@dataclass(frozen=True)
class GroupUsage:
    """What a process and the processes that it started use.

    Attributes:
        cpu: Processor time of all together, s.
        memory: Resident memory of the largest, bytes.
    """

    cpu: float
    memory: int


def group_usage(pid: int) -> GroupUsage:
    """Measure a process and its descendants; zero if it has ended.

    Args:
        pid: Number of the process.
    """
    import psutil

    cpu, memory = 0.0, 0
    try:
        process = psutil.Process(pid)
        group = [process, *process.children(recursive=True)]
    except psutil.Error:
        return GroupUsage(cpu, memory)
    for member in group:
        try:
            times = member.cpu_times()
            cpu += times.user + times.system
            cpu += getattr(times, "children_user", 0.0) + getattr(times, "children_system", 0.0)
            memory = max(memory, int(member.memory_info().rss))
        except psutil.Error:
            continue  # it has ended
    return GroupUsage(cpu, memory)


def cpu_seconds() -> float:
    """Return the processor time of this process and of its ended children, s.

    On Windows, children are not included.
    """
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def peak_memory_mb() -> float:
    """Return the largest memory of this process or of its largest ended child, MB.

    On Windows, children are not included.
    """
    if sys.platform == "win32":
        import psutil

        return float(psutil.Process().memory_info().peak_wset) / 2**20
    import resource

    used = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    unit = 1 if sys.platform == "darwin" else 1024  # bytes
    return max(u.ru_maxrss for u in used) * unit / 2**20


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Use one thread for linear algebra, in the libraries loaded so far.

    With several threads the last digits of sums depend on the number of cores, and a search can
    end elsewhere. The matrices here are too small to gain from more threads: training took four
    times as long on two cores. It can also decorate a function.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):
        yield
