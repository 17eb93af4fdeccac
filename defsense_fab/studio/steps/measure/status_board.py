"""What the tasks of the step Measure do, as the page shows it."""

from __future__ import annotations

import threading
from typing import Literal

import msgspec

from ....core.errors import DefsenseError
from ....workflow.view import Problem, WebServer
from ...background.background_job import CANCELLED
from ...messages.measure import MeasureResults, MeasureStatus, TaskState, TaskStatus

TaskName = Literal["check", "record", "train", "specimen", "live"]


class StatusBoard:
    """Publishes what each task does, and the last results; call it from any thread.

    Args:
        server: Sends events to the browsers.

    Attributes:
        status: What the tasks do.
        results: The last results.
    """

    def __init__(self, server: WebServer) -> None:
        self._server, self._lock = server, threading.Lock()
        idle = TaskStatus()
        self.status = MeasureStatus(check=idle, record=idle, train=idle, specimen=idle, live=idle)
        self.results = MeasureResults()
        server.publish(self.status)
        server.publish(self.results)

    def task(self, name: TaskName) -> TaskStatus:
        """Return what a task does."""
        status: TaskStatus = getattr(self.status, name)
        return status

    def show(
        self,
        name: TaskName,
        text: str,
        code: str = "",
        *,
        state: TaskState = "idle",
        error: Exception | None = None,
    ) -> None:
        """Show what a task does.

        Args:
            name: The task.
            text: A text; empty for none.
            code: Stable identifier of what came of it.
            state: Whether it runs.
            error: Why it failed, or None.
        """
        problem = None if error is None else Problem.of(error)
        task = TaskStatus(state=state, code=code, text=text, problem=problem)
        with self._lock:
            self.status = msgspec.structs.replace(self.status, **{name: task})
            self._server.publish(self.status)

    def show_end(self, name: TaskName, error: Exception | None) -> None:
        """Show how a task ended, without a text."""
        if isinstance(error, DefsenseError) and error.code == CANCELLED:
            self.show(name, "Canceled", CANCELLED)
        else:
            self.show(name, "", error=error)

    def show_result(self, **results: msgspec.Struct | None) -> None:
        """Replace results by their names."""
        with self._lock:
            changed = msgspec.structs.replace(self.results, **results)
            if changed != self.results:
                self.results = changed
                self._server.publish(changed)
