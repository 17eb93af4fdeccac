"""Run long tasks of a part of the panel in a child process, with their progress and status."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...core.errors import DefsenseError
from ..workbench.background_job import BackgroundJob, run_with_progress
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench


class PanelJob:
    """One task at a time; its error, or the text of its result, becomes the status.

    Args:
        bench: The workbench.
        status: Shows the progress and the result.

    Attributes:
        process: Runs the tasks.
    """

    def __init__(self, bench: Workbench, status: StatusText) -> None:
        self._bench, self._status = bench, status
        self._on_result: Callable[[Any], None] = lambda _: None
        self.process = BackgroundJob("job", self._show_progress, self.end)

    @property
    def shows_progress(self) -> bool:
        """Whether the progress of a task is visible."""
        return bool(self._bar.visible)

    def add_panel(self) -> None:
        """Add the button that cancels, the progress and the status to the open folder."""
        gui = self._bench.server.gui
        self._cancel = self._bench.button(
            "Cancel",
            "Stop the job and keep all files",
            lambda: self.process.cancel(),
            visible=False,
        )
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._status.add_panel(gui)

    def start(self, task: Callable[..., Any], on_result: Callable[[Any], None]) -> None:
        """Start a task unless one is running.

        Args:
            task: Picklable function that takes the argument `progress`.
            on_result: Called with the result of the task.
        """
        if self.process.is_running:
            self._status.show_problem("A job is running. Wait for it or cancel it.", "busy")
            return
        self._on_result = on_result
        self._status.show("Starting ...")
        self._bar.value = 0.0
        self._bar.visible = self._cancel.visible = True
        self.process.start(run_with_progress, task)

    def end(self, error: DefsenseError | None, result: Any) -> None:
        """Show the error of a task that has ended, or pass on its result."""
        self._bar.visible = self._cancel.visible = False
        if error is not None:
            self._status.show_error(error)
        else:
            self._status.show("")
            self._on_result(result)

    def close(self) -> None:
        """Cancel the task and wait for its process."""
        self.process.close()

    def _show_progress(self, share: float, message: str) -> None:
        self._bar.value = 100 * share
        self._status.show(message)
