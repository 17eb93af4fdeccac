"""What systems do differently with processes: ending one with all that it started, a limit of its
memory, and what it took. `sys.platform` is asked so that mypy checks each system's own branch."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# Linear algebra in one thread, whose sums do not depend on how many cores there are.


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within it the BLAS libraries that are loaded use one thread: with several, results differ in
    their last digits, and a search can end elsewhere. Matrices here are too small to gain from
    more: training took four times as long on two cores. As a decorator, within the function."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):
        yield


#: For `subprocess.Popen`: a group of its own, which Ctrl-C does not reach and `end_group` ends.
if sys.platform == "win32":
    OWN_GROUP: dict[str, Any] = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
else:
    OWN_GROUP: dict[str, Any] = {"start_new_session": True}


def end_group(pid: int) -> None:
    """End the process `pid`, begun with `OWN_GROUP`, and what it started. On Windows what is left
    of an ended process cannot be found any more."""
    if sys.platform == "win32":
        subprocess.run(["taskkill", "/F", "/T", "/PID", str(pid)], check=False, capture_output=True)
        return
    try:
        os.killpg(pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):  # it has ended; macOS refuses for a zombie
        return


def end_own_group() -> None:
    """End this process, which was begun with `OWN_GROUP`, and all that it started."""
    if sys.platform != "win32":
        os.killpg(0, signal.SIGKILL)
    end_group(os.getpid())


def was_killed(code: int) -> bool:
    """Whether an exit code tells of an end from outside, as for want of memory."""
    return sys.platform != "win32" and -code == signal.SIGKILL


def limit_memory(size: int) -> None:
    """Let this process have `size` bytes at most, where the system can: not on Windows, and macOS
    refuses limits of address space."""
    if sys.platform == "win32":
        return
    import resource

    try:
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
    except (ValueError, OSError):
        if sys.platform == "linux":
            raise


def cpu_seconds() -> float:
    """Of this process and of its children that have ended (not of those on Windows), s."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def peak_memory() -> float:
    """Of this process and of its largest child that has ended (not of those on Windows), MB."""
    if sys.platform == "win32":
        import psutil

        return float(psutil.Process().memory_info().peak_wset) / 2**20
    import resource

    used = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    unit = 1 if sys.platform == "darwin" else 1024  # bytes
    return max(u.ru_maxrss for u in used) * unit / 2**20
