"""A module run in a process of its own, which Ctrl-C, a time limit and the caller's end all stop.

In the caller's process a script would leave its modules behind, and native code takes Ctrl-C away
or ends the program without a word.
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
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import IO, Any

from ...core.errors import BodyError, DefsenseError
from ...core.machine.processes import OWN_GROUP, end_group, end_own_group, was_killed
from .. import kernels

# The CAD kernel, which takes seconds to load, loaded while another process works.


@contextmanager
def loaded_meanwhile(module: str) -> Iterator[Callable[[], ModuleType]]:
    """Imports that module of `kernels` beside what is done meanwhile; what is given waits for it,
    and gives `kernels.brep`.

    Nothing else may import the kernel before: two threads that do so at once find it half made. A
    program that ended before the import is done would show its traceback: it waits at the end.
    An import that fails is tried again, and fails, where the kernel is asked for.
    """

    def load() -> None:
        with suppress(ImportError):
            import_module(f"{kernels.__name__}.{module}")

    thread = threading.Thread(target=load)

    def brep() -> ModuleType:
        thread.join()
        return import_module(f"{kernels.__name__}.brep")

    thread.start()
    try:
        yield brep
    finally:
        thread.join()


#: What a child leaves as its error where it has no memory, or not enough.
OUT_OF_MEMORY = "out of memory"
#: Between calls of `on_wait`, s.
_EVERY = 2.0


@dataclass(frozen=True)
class Failure:
    """How it is told that a child failed: an `error` whose text begins with `who`, and what to do
    where it ended early (`crashed`) or took too long (`slow`)."""

    error: type[DefsenseError]
    who: str
    crashed: str
    slow: str


@contextlib.contextmanager
def finished(
    module: str,
    give: Callable[[Path], None],
    result: str,
    limit: float,
    failure: Failure,
    relay: bool = False,
    on_wait: Callable[[], None] | None = None,
) -> Iterator[Path]:
    """Run `python -m module FOLDER` and yield FOLDER, a temporary one that then holds `result`.

    `give` writes what the module needs into the folder beforehand. With `relay` what the module
    prints goes to standard error; `on_wait` is called every few seconds meanwhile. Raises the
    failure's error where no `result` is left, or where the module takes more than `limit` s.
    """
    with tempfile.TemporaryDirectory(prefix="defsense-") as name:
        folder = Path(name)
        give(folder)
        code, said = _run(module, folder, limit, failure, relay, on_wait)
        if not (folder / result).exists():
            why = f"signal {-code}" if code < 0 else f"exit code {code}"
            if was_killed(code):
                why += ", perhaps for want of memory"
            why += f": {said}" if said else ""
            error = failure.error(
                f"{failure.who} ended early ({why}); {failure.crashed}",
                code="process-ended-early",
                returncode=code,
                last_line=said,
            )
            error.is_machine_limit = was_killed(code)
            raise error
        yield folder


def refusal(result: Mapping[str, Any], text: str) -> BodyError:
    """Return the error that a child left in its `result`: its `code` and `data`, with this text."""
    return BodyError(text, code=result["code"], **result["data"])


def _run(
    module: str,
    folder: Path,
    limit: float,
    failure: Failure,
    relay: bool,
    on_wait: Callable[[], None] | None,
) -> tuple[int, str]:
    """The exit code, and the last line that was printed."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-u", "-m", module, str(folder)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p or str(Path.cwd()) for p in sys.path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        errors="replace",
        **OWN_GROUP,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    last: deque[str] = deque(maxlen=1)
    reader = threading.Thread(target=_read, args=(process.stdout, last, relay), daemon=True)
    reader.start()
    try:
        code = _ended(process, limit, on_wait)
    except subprocess.TimeoutExpired:
        error = failure.error(
            f"{failure.who} did not end within {round(limit, 2):g} s and was stopped;"
            f" {failure.slow}",
            code="time-limit-exceeded",
            limit=limit,
        )
        error.is_machine_limit = True
        raise error from None
    finally:
        end_group(process.pid)  # what it started ends, too
        process.wait()
        process.stdin.close()
        reader.join(1.0)  # a process that the module started may hold the other end
        if not reader.is_alive():
            process.stdout.close()
    return code, last[0] if last else ""


def _ended(process: subprocess.Popen[str], limit: float, on_wait: Callable[[], None] | None) -> int:
    """The exit code. Raises TimeoutExpired after `limit` s."""
    until = time.monotonic() + limit
    while on_wait is not None and until - time.monotonic() > _EVERY:
        try:
            return process.wait(_EVERY)
        except subprocess.TimeoutExpired:
            on_wait()
    return process.wait(max(until - time.monotonic(), 0.0))


def _read(stream: IO[str], last: deque[str], relay: bool) -> None:
    for line in stream:
        if line.strip():
            last.append(" ".join(line.split())[-200:])
        if relay:
            sys.stderr.write(line)


def end_with_parent() -> None:
    """Called by the module first: its process and all that it starts end when the caller has gone,
    however it went. Standard input, through which that is known, is empty from then on. Native code
    that keeps the interpreter's lock, as the mesher's does, delays the end until it comes back."""
    lifeline = os.dup(0)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)

    def watch() -> None:
        os.read(lifeline, 1)  # returns when the caller's end of the pipe is closed
        end_own_group()

    threading.Thread(target=watch, daemon=True).start()
