"""Run a module in a child process that Ctrl-C, a time limit and the caller's end all stop.

In the caller's process a body script would leave its modules behind, and native code would block
Ctrl-C or end the program without a message. A child avoids both.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import IO, Any, TypeVar

from ...core.errors import DefsenseError
from ...core.machine.processes import NEW_GROUP, kill_group, kill_own_group, was_killed
from .. import kernels

E = TypeVar("E", bound=DefsenseError)

#: Error text that a child writes when it runs out of memory.
OUT_OF_MEMORY = "out of memory"
#: Time between calls of `on_wait`, s.
WAIT_INTERVAL_S = 2.0


@dataclass(frozen=True)
class ChildFailure:
    """How to report that a child failed.

    Attributes:
        error: Class of the error to raise.
        where: What failed: the file or step.
        subject: Noun phrase that starts the problem, such as "the script".
        crash_action: What the user can do if the child ended early.
        timeout_action: What the user can do if the child took too long.
    """

    error: type[DefsenseError]
    where: str
    subject: str
    crash_action: str = ""
    timeout_action: str = ""


@contextlib.contextmanager
def run_module(
    module: str,
    write_task: Callable[[Path], None],
    result: str,
    limit: float,
    failure: ChildFailure,
    relay: bool = False,
    on_wait: Callable[[], None] | None = None,
) -> Iterator[Path]:
    """Run `python -m module FOLDER` and yield the temporary FOLDER with the results.

    Args:
        module: Dotted name of the module to run.
        write_task: Writes the module's input into the folder beforehand.
        result: Name of the file that the module must leave in the folder.
        limit: Time limit, s.
        failure: Error to raise if the module fails.
        relay: Whether to copy the module's output to standard error.
        on_wait: Called every few seconds while the module runs.

    Yields:
        The folder, which holds `result`.

    Raises:
        DefsenseError: Of the class `failure.error`, with the code `process-ended-early` if the
            module left no `result`, or `time-limit-exceeded`.
    """
    with tempfile.TemporaryDirectory(prefix="defsense-") as name:
        folder = Path(name)
        write_task(folder)
        returncode, last_line = _run(module, folder, limit, failure, relay, on_wait)
        if not (folder / result).exists():
            reason = f"signal {-returncode}" if returncode < 0 else f"exit code {returncode}"
            if was_killed(returncode):
                reason += ", perhaps out of memory"
            reason += f": {last_line}" if last_line else ""
            error = failure.error(
                f"{failure.subject} ended early ({reason})",
                code="process-ended-early",
                where=failure.where,
                action=failure.crash_action,
                returncode=returncode,
                last_line=last_line,
            )
            error.is_machine_limit = was_killed(returncode)
            raise error
        yield folder


def error_record(error: DefsenseError) -> dict[str, Any]:
    """Return the parts of an error as JSON data, for `error_from_record`."""
    return {
        "problem": error.problem,
        "code": error.code,
        "where": error.where,
        "action": error.action,
        "data": error.data,
    }


def error_from_record(kind: type[E], record: Mapping[str, Any], where: str | None = None) -> E:
    """Recreate an error that a child wrote with `error_record`.

    Args:
        kind: Class of the error.
        record: The child's record.
        where: Place to name instead of the child's.

    Returns:
        The error.
    """
    return kind(
        record["problem"],
        code=record["code"],
        where=record["where"] if where is None else where,
        action=record["action"],
        **record["data"],
    )


def _run(
    module: str,
    folder: Path,
    limit: float,
    failure: ChildFailure,
    relay: bool,
    on_wait: Callable[[], None] | None,
) -> tuple[int, str]:
    """Return the exit code and the last line that the module printed."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-u", "-m", module, str(folder)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p or str(Path.cwd()) for p in sys.path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        errors="replace",
        **NEW_GROUP,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    last: deque[str] = deque(maxlen=1)
    reader = threading.Thread(target=_read, args=(process.stdout, last, relay), daemon=True)
    reader.start()
    try:
        returncode = _wait(process, limit, on_wait)
    except subprocess.TimeoutExpired:
        error = failure.error(
            f"{failure.subject} did not end within {round(limit, 2):g} s and was stopped",
            code="time-limit-exceeded",
            where=failure.where,
            action=failure.timeout_action,
            limit=limit,
        )
        error.is_machine_limit = True
        raise error from None
    finally:
        kill_group(process.pid)  # with all processes that it started
        process.wait()
        process.stdin.close()
        reader.join(1.0)  # a process that the module started may hold the other end
        if not reader.is_alive():
            process.stdout.close()
    return returncode, last[0] if last else ""


def _wait(process: subprocess.Popen[str], limit: float, on_wait: Callable[[], None] | None) -> int:
    """Return the exit code, or raise TimeoutExpired after `limit` s."""
    deadline = time.monotonic() + limit
    while on_wait is not None and deadline - time.monotonic() > WAIT_INTERVAL_S:
        try:
            return process.wait(WAIT_INTERVAL_S)
        except subprocess.TimeoutExpired:
            on_wait()
    return process.wait(max(deadline - time.monotonic(), 0.0))


def _read(stream: IO[str], last: deque[str], relay: bool) -> None:
    for line in stream:
        if line.strip():
            last.append(" ".join(line.split())[-200:])
        if relay:
            sys.stderr.write(line)


def end_with_parent() -> None:
    """End this process, and all that it started, when the process that started it ends.

    A module calls this first. Standard input, through which the end is noticed, is empty from then
    on. Native code that holds the interpreter's lock, such as the mesher's, delays the end until it
    releases the lock.
    """
    lifeline = os.dup(0)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)

    def watch() -> None:
        os.read(lifeline, 1)  # returns when the parent's end of the pipe is closed
        kill_own_group()

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def load_kernel_meanwhile(module: str) -> Iterator[Callable[[], ModuleType]]:
    """Import a CAD kernel in a thread while another process works, since it takes seconds.

    Nothing else may import the kernel before the thread ends: two threads that import it at once
    find it half initialized. The context waits for the thread at its end, since a program that ends
    before would show a traceback. If the import fails it is repeated, and fails, when the kernel is
    requested.

    Args:
        module: Name of the module of `geometry.kernels` to import: `occ` or `brep`.

    Yields:
        A function that waits for the import and returns the module `kernels.brep`.
    """

    def load() -> None:
        with contextlib.suppress(ImportError):
            import_module(f"{kernels.__name__}.{module}")

    thread = threading.Thread(target=load)

    def wait_for_brep() -> ModuleType:
        thread.join()
        return import_module(f"{kernels.__name__}.brep")

    thread.start()
    try:
        yield wait_for_brep
    finally:
        thread.join()
