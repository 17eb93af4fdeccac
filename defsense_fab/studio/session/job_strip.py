"""The work in the background, one job at a time, and what the page shows of it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...core.errors import DefsenseError
from ...workflow.view import Event, Problem
from ..background.background_job import CANCELLED, BackgroundJob
from ..messages.shell import Job

_CANCEL_TIMEOUT_S = 5.0  # in which a canceled job ends


def _ignore(*_: Any) -> None:
    pass


@dataclass(frozen=True)
class Work:
    """A job.

    Attributes:
        name: Noun for messages, such as "build".
        title: What is done, such as "Optimize the cords".
        job: Function of a module, called in a child process with a JobReporter and `arguments`.
        arguments: Picklable arguments.
        on_end: Called with the error, or None, and the result.
        on_item: Called with each intermediate result.
        can_pause: Whether it can be paused.
        gives_way: Whether it is canceled when another job is started.
    """

    name: str
    title: str
    job: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    on_end: Callable[[DefsenseError | None, Any], None] = _ignore
    on_item: Callable[[Any], None] = _ignore
    can_pause: bool = False
    gives_way: bool = False


class JobStrip:
    """Runs one job at a time in a child process.

    Args:
        publish: Sends an event to the browsers.

    Attributes:
        job: What is shown.
        is_replacing: Whether a job is canceled now so that another one can start.
    """

    def __init__(self, publish: Callable[[Event], None]) -> None:
        self._publish = publish
        self._lock = threading.Lock()
        self._work: Work | None = None
        self._background: BackgroundJob | None = None
        self.job = Job(name="", title="", state="idle")
        self.is_replacing = False

    @property
    def _can_replace(self) -> bool:
        return self.is_running and self._work is not None and self._work.gives_way

    @property
    def is_running(self) -> bool:
        """Whether a job runs or is paused."""
        return self._background is not None and self._background.is_running

    def start(self, work: Work) -> None:
        """Start a job.

        Raises:
            DefsenseError: Another job is running.
            StorageError: The system cannot start a process.
        """
        if self._can_replace:
            self.is_replacing = True
            self.cancel()
            self.wait(_CANCEL_TIMEOUT_S)
            self.is_replacing = False
        with self._lock:
            if self.is_running:
                raise self._still_running()
            background = BackgroundJob(
                work.name, self._show_progress, self._end, work.on_item, self._show_pause
            )
            self._work, self._background = work, background
            self._show(
                Job(
                    name=work.name,
                    title=work.title,
                    state="running",
                    message="Starting",
                    can_pause=work.can_pause,
                    gives_way=work.gives_way,
                )
            )
            background.start(work.job, *work.arguments)

    def check_idle(self) -> None:
        """Check that no job runs, except one that gives way to others.

        Raises:
            DefsenseError: A job is running (`job-running`).
        """
        if self.is_running and not self._can_replace:
            raise self._still_running()

    def pause(self) -> None:
        """Pause the job at its next report."""
        if self._background is not None:
            self._background.pause()

    def resume(self) -> None:
        """Continue after a pause."""
        if self._background is not None:
            self._background.resume()

    def cancel(self) -> None:
        """Terminate the job; its `on_end` follows."""
        if self._background is not None:
            self._background.cancel()

    def wait(self, timeout_s: float) -> bool:
        """Wait until no job runs; return False after `timeout_s`."""
        return self._background is None or self._background.wait(timeout_s)

    def close(self) -> None:
        """Cancel the job and wait for its process."""
        if self._background is not None:
            self._background.close()

    def forget_problem(self) -> None:
        """Forget why the last job failed, as the device has changed since."""
        with self._lock:
            if not self.is_running and self.job.problem is not None:
                self._show(Job(name="", title="", state="idle"))

    def _still_running(self) -> DefsenseError:
        return DefsenseError(
            f"{self.job.title.lower()}: this is still running",
            code="job-running",
            action="Wait until it ends, or cancel it",
        )

    def _show(self, job: Job) -> None:
        self.job = job
        self._publish(job)

    def _change(self, **values: Any) -> None:
        now = {name: getattr(self.job, name) for name in Job.__struct_fields__}
        self._show(Job(**{**now, **values}))

    def _show_progress(self, share: float, message: str) -> None:
        share = max(share, self.job.share)  # a bar that goes back is no measure
        self._change(state="running", share=share, message=message)

    def _show_pause(self, is_paused: bool) -> None:
        self._change(state="paused" if is_paused else "running")

    def _end(self, error: DefsenseError | None, result: Any) -> None:
        work = self._work
        assert work is not None
        if error is None:
            self._change(state="idle", share=1.0, message="Done", problem=None)
        elif error.code == CANCELLED:
            self._change(state="idle", message="Canceled", problem=None)
        else:
            self._change(state="idle", message="", problem=Problem.of(error))
        work.on_end(error, result)
