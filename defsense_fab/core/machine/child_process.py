"""Run a module in a child process that Ctrl-C, limits and the caller's end all stop.

In the caller's process a body script would leave its modules behind, and a reader of files of other
programs could block Ctrl-C, take all memory, or end the program without a message. A child avoids
all of this.
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
from pathlib import Path
from typing import IO, Any, TypeVar

from ..errors import DefsenseError
from .processes import (
    NEW_GROUP,
    GroupUsage,
    group_usage,
    kill_group,
    kill_own_group,
    limit_memory,
    was_killed,
)

E = TypeVar("E", bound=DefsenseError)

#: Error text that a child writes when it runs out of memory.
OUT_OF_MEMORY = "out of memory"
#: Time between calls of `on_wait`, s.
WAIT_INTERVAL_S = 2.0
#: Time between measurements of a child's processor time and memory, s.
CHECK_INTERVAL_S = 0.5
#: Wall time after which a child that does not use its processor time is stopped, per CPU second.
MAX_WALL_RATIO = 4.0
_MEMORY_VARIABLE = "DEFSENSE_CHILD_MEMORY"


@dataclass(frozen=True)
class ChildLimits:
    """Limits of a child process and the processes that it starts.

    Attributes:
        wall: Wall time, s.
        cpu: Processor time of all processes together, s; None for no limit.
        memory: Memory of each process, bytes; None for no limit.
    """

    wall: float
    cpu: float | None = None
    memory: int | None = None

    @classmethod
    def of_cpu_time(cls, seconds: float, memory: int | None = None) -> ChildLimits:
        """Return limits by processor time, which a busy machine does not use up.

        Args:
            seconds: Processor time, s.
            memory: Memory of each process, bytes; None for no limit.
        """
        return cls(MAX_WALL_RATIO * seconds, seconds, memory)


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
    limits: ChildLimits,
    failure: ChildFailure,
    relay: bool = False,
    on_wait: Callable[[], None] | None = None,
) -> Iterator[Path]:
    """Run `python -m module FOLDER` and yield the temporary FOLDER with the results.

    Args:
        module: Dotted name of the module to run.
        write_task: Writes the module's input into the folder beforehand.
        result: Name of the file that the module must leave in the folder.
        limits: Limits of time and memory.
        failure: Error to raise if the module fails.
        relay: Whether to copy the module's output to standard error.
        on_wait: Called every few seconds while the module runs.

    Yields:
        The folder, which holds `result`.

    Raises:
        DefsenseError: Of the class `failure.error`, with the code `process-ended-early` if the
            module left no `result`, `time-limit-exceeded`, or `memory-limit-exceeded`.
    """
    with tempfile.TemporaryDirectory(prefix="defsense-") as name:
        folder = Path(name)
        write_task(folder)
        returncode, last_line = _run(module, folder, limits, failure, relay, on_wait)
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


class _LimitExceededError(Exception):
    """A child exceeded a limit.

    Attributes:
        code: Code of the error to raise.
        problem: What the child did, without its subject.
        limit: The limit, s or bytes.
    """

    def __init__(self, code: str, problem: str, limit: float) -> None:
        super().__init__(problem)
        self.code, self.problem, self.limit = code, problem, limit


def _run(
    module: str,
    folder: Path,
    limits: ChildLimits,
    failure: ChildFailure,
    relay: bool,
    on_wait: Callable[[], None] | None,
) -> tuple[int, str]:
    """Return the exit code and the last line that the module printed."""
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(p or str(Path.cwd()) for p in sys.path),
    }
    if limits.memory is not None:
        environment[_MEMORY_VARIABLE] = str(limits.memory)
    process = subprocess.Popen(
        [sys.executable, "-P", "-u", "-m", module, str(folder)],
        env=environment,
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
        returncode = _wait(process, limits, on_wait)
    except _LimitExceededError as exceeded:
        error = failure.error(
            f"{failure.subject} {exceeded.problem} and was stopped",
            code=exceeded.code,
            where=failure.where,
            action=failure.timeout_action,
            limit=exceeded.limit,
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


def _wait(
    process: subprocess.Popen[str], limits: ChildLimits, on_wait: Callable[[], None] | None
) -> int:
    """Return the exit code, or raise _LimitExceededError."""
    started_at = reported_at = time.monotonic()
    while True:
        elapsed = time.monotonic() - started_at
        try:
            return process.wait(max(min(CHECK_INTERVAL_S, limits.wall - elapsed), 0.0))
        except subprocess.TimeoutExpired:
            elapsed = time.monotonic() - started_at
        if elapsed >= limits.wall:
            limit = limits.wall if limits.cpu is None else limits.cpu
            problem = f"did not end within {round(limits.wall, 2):g} s"
            raise _LimitExceededError("time-limit-exceeded", problem, limit)
        if _needs_measuring(limits, elapsed):
            _check_usage(group_usage(process.pid), limits)
        if on_wait is not None and time.monotonic() - reported_at > WAIT_INTERVAL_S:
            on_wait()
            reported_at = time.monotonic()


def _needs_measuring(limits: ChildLimits, elapsed: float) -> bool:
    """Return whether a child may have exceeded a limit that only a measurement shows."""
    if limits.memory is not None and sys.platform != "linux":  # Linux limits the child itself
        return True
    return limits.cpu is not None and elapsed * (os.cpu_count() or 1) > limits.cpu


def _check_usage(usage: GroupUsage, limits: ChildLimits) -> None:
    if limits.cpu is not None and usage.cpu > limits.cpu:
        problem = f"did not end within {round(limits.cpu, 2):g} s of processor time"
        raise _LimitExceededError("time-limit-exceeded", problem, limits.cpu)
    if limits.memory is not None and usage.memory > limits.memory:
        problem = f"takes more than {limits.memory / 2**30:.3g} GB of memory"
        raise _LimitExceededError("memory-limit-exceeded", problem, limits.memory)


def _read(stream: IO[str], last: deque[str], relay: bool) -> None:
    for line in stream:
        if line.strip():
            last.append(" ".join(line.split())[-200:])
        if relay:
            sys.stderr.write(line)


def start_child() -> None:
    """Apply the memory limit, and end this process and all it started when its parent ends.

    A module that `run_module` runs calls this first. Standard input, through which the parent's end
    is noticed, is empty from then on. Native code that holds the interpreter's lock, such as the
    mesher's, delays the end until it releases the lock.
    """
    if limit := os.environ.pop(_MEMORY_VARIABLE, ""):
        limit_memory(int(limit))
    lifeline = os.dup(0)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)

    def watch() -> None:
        os.read(lifeline, 1)  # returns when the parent's end of the pipe is closed
        kill_own_group()

    threading.Thread(target=watch, daemon=True).start()
