"""A job in a child process that reports progress and can be paused and canceled.

A job that fails, or takes too much memory, does not affect the studio.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any, Literal

from ...core.errors import DefsenseError, StorageError

if sys.platform == "win32":
    from multiprocessing.connection import PipeConnection as Connection
else:
    from multiprocessing.connection import Connection

CANCELLED = "cancelled"  # code of the error of a job that was canceled
PAUSE, RESUME = "pause", "resume"  # messages to the child process
_CLOSE_TIMEOUT_S = 5.0  # time in which a canceled process has to end
_STAGE_PART = 0.8  # of the remaining share that a stage takes
_log = logging.getLogger(__name__)


class JobReporter:
    """The child process's end of the pipe to the studio.

    A report waits while the job is paused. It raises EOFError if the studio is gone; an OSError
    would be mistaken for an error of the job's own files.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._stage, self._start, self._share = "", 0.0, 0.0

    def progress(self, share: float, message: str) -> None:
        """Report the completed share (0 to 1) and a message."""
        self._send("progress", (share, message))

    def stage_progress(self, stage: str, share: float, message: str) -> None:
        """Report the progress of a stage; use it where a function takes a progress callback.

        The number of stages is not known: each takes a part of what the earlier ones have left.
        """
        if stage != self._stage:
            self._stage, self._start = stage, self._share
        whole = self._start + (1 - self._start) * _STAGE_PART * min(max(share, 0.0), 1.0)
        self._share = max(self._share, whole)
        self.progress(self._share, f"{stage}: {message}")

    def item(self, item: Any) -> None:
        """Send an intermediate result, which must be picklable."""
        self._send("item", item)

    def _send(self, kind: str, content: Any) -> None:
        try:
            while self._connection.poll():
                if self._connection.recv() == PAUSE:
                    self._connection.send(("paused", True))
                    while self._connection.recv() != RESUME:
                        pass
                    self._connection.send(("paused", False))
            self._connection.send((kind, content))
        except OSError:
            raise EOFError from None


class BackgroundJob:
    """Run one job at a time in a child process.

    The callbacks are called on a thread of this object, in the order of the job's reports.

    Args:
        name: Noun for messages, such as "build".
        on_progress: Called with the completed share (0 to 1) and a message.
        on_end: Called once with an error, or None, and the job's result, which is None after an
            error. The code of the error is `CANCELLED` after `cancel`.
        on_item: Called with each intermediate result.
        on_pause: Called with True when the job pauses and with False when it resumes.
    """

    def __init__(
        self,
        name: str,
        on_progress: Callable[[float, str], None],
        on_end: Callable[[DefsenseError | None, Any], None],
        on_item: Callable[[Any], None] = lambda _: None,
        on_pause: Callable[[bool], None] = lambda _: None,
    ) -> None:
        self._name = name
        self._on_progress, self._on_end = on_progress, on_end
        self._on_item, self._on_pause = on_item, on_pause
        self._process: Any = None
        self._pipe: Connection | None = None
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._ended.set()
        self._is_cancelled = self._is_paused = False

    @property
    def is_running(self) -> bool:
        """Whether a job runs or is paused."""
        return self._process is not None

    @property
    def state(self) -> Literal["idle", "running", "paused"]:
        """What the job does now."""
        if not self.is_running:
            return "idle"
        return "paused" if self._is_paused else "running"

    def start(self, job: Callable[..., Any], *arguments: Any) -> bool:
        """Start a job unless one is running.

        Args:
            job: Function of a module, called in the child process with a JobReporter and the
                arguments. Its result is passed to `on_end`.
            arguments: Picklable arguments of the function.

        Returns:
            Whether the job started.

        Raises:
            StorageError: The system cannot start a process.
        """
        with self._lock:
            if self._process is not None:
                return False
            context = multiprocessing.get_context("spawn")
            parent_end, child_end = context.Pipe()
            self._is_cancelled = self._is_paused = False
            process = context.Process(
                target=_run_in_child, args=(job, self._name, child_end, arguments), daemon=True
            )
            try:
                process.start()
            except OSError as error:
                raise StorageError(
                    f"cannot start: {error.strerror}",
                    code="process-not-started",
                    where=f"the {self._name}",
                    action="Close other programs",
                ) from None
            self._process, self._pipe = process, parent_end
            self._ended.clear()
            child_end.close()
        threading.Thread(target=self._follow, args=(parent_end,), daemon=True).start()
        return True

    def pause(self) -> None:
        """Pause the job at its next report."""
        self._send(PAUSE)

    def resume(self) -> None:
        """Continue after a pause."""
        self._send(RESUME)

    def cancel(self) -> None:
        """Terminate the job and return at once; `on_end` follows."""
        with self._lock:
            if self._process is not None:
                self._is_cancelled = True
                self._process.terminate()

    def wait(self, timeout_s: float) -> bool:
        """Wait until no job runs and `on_end` has returned; return False after `timeout_s`."""
        return self._ended.wait(timeout_s)

    def close(self) -> None:
        """Cancel the job and wait for its process."""
        self.cancel()
        process = self._process
        if process is not None:
            process.join(_CLOSE_TIMEOUT_S)

    def _send(self, order: str) -> None:
        with self._lock:
            if self._process is not None and self._pipe is not None:
                try:
                    self._pipe.send(order)
                except OSError:  # the process has ended, which `on_end` is about to report
                    return

    def _follow(self, connection: Connection) -> None:
        """Receive the reports of the process until it ends."""
        error: DefsenseError | None
        result: Any = None
        while True:
            try:
                kind, content = connection.recv()
            except (EOFError, OSError):  # the process is gone
                error = DefsenseError(
                    "ended unexpectedly",
                    code="process-ended-early",
                    where=f"the {self._name}",
                    action="Check whether the memory is full",
                )
                break
            if kind == "end":
                error, result = content
                break
            self._pass_on(kind, content)
        self._process.join()
        if self._is_cancelled:
            error, result = DefsenseError("cancelled", code=CANCELLED), None
        with self._lock:
            self._process = self._pipe = None
            self._is_paused = False
        connection.close()
        try:
            self._on_end(error, result)
        finally:
            with self._lock:
                if self._process is None:  # `on_end` may have started another job
                    self._ended.set()

    def _pass_on(self, kind: str, content: Any) -> None:
        """Call the callback for a report; its failure does not end the job."""
        try:
            if kind == "progress":
                self._on_progress(*content)
            elif kind == "item":
                self._on_item(content)
            else:
                self._is_paused = content
                self._on_pause(content)
        except Exception:
            _log.exception("a report of the %s was not handled", self._name)


def run_with_progress(reporter: JobReporter, job: Callable[..., Any]) -> Any:
    """Call a job that takes the argument `progress`; pass this to `BackgroundJob.start`."""
    return job(progress=reporter.stage_progress)


def _run_in_child(
    job: Callable[..., Any], name: str, connection: Connection, arguments: tuple[Any, ...]
) -> None:
    """Run a job in the child process; the studio ends it, so Ctrl-C is left to the studio."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdout.flush()
    os.dup2(2, 1)  # native libraries print to standard output
    try:
        connection.send(("end", (None, job(JobReporter(connection), *arguments))))
    except DefsenseError as error:
        try:
            connection.send(("end", (error, None)))
        except Exception:  # its data cannot be pickled
            connection.send(("end", (DefsenseError(str(error), code=error.code), None)))
    except EOFError:  # the studio is gone
        return
    except Exception as error:
        problem = DefsenseError(
            f"failed ({type(error).__name__}: {error})", code="job-failed", where=f"the {name}"
        )
        connection.send(("end", (problem, None)))
