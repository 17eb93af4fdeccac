"""Run one guided task at a time, with its screen in the panel."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from ...workflow.view import GuidedScreen
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench

_CLOSE_TIMEOUT_S = 10.0  # time in which a guided run has to end


class GuidedTask:
    """Run one guided task at a time on a thread, with its screen in the panel.

    Args:
        bench: The workbench.
        name: Noun for messages, such as "recording".
        status: Shows what the task does.
        on_busy: Called with True before a task is prepared, and with False once it has ended.

    Attributes:
        screen: The screen of the running task, or None.
        finished_steps: Number of finished steps of the last task.
        step_count: Number of its steps.
    """

    def __init__(
        self, bench: Workbench, name: str, status: StatusText, on_busy: Callable[[bool], None]
    ) -> None:
        self._bench, self._name, self._status, self._on_busy = bench, name, status, on_busy
        self._worker = LatestWorker[Callable[[], None]](
            lambda work: work(), bench.status.show_error
        )
        self.screen: GuidedScreen | None = None
        self.finished_steps = self.step_count = 0

    @property
    def is_busy(self) -> bool:
        """Whether a task is prepared, runs or ends."""
        return self._worker.is_busy

    def wait(self, timeout_s: float) -> bool:
        """Wait until no task runs; return False after `timeout_s`."""
        return self._worker.wait(timeout_s)

    def start(self, run: Callable[[], None]) -> None:
        """Start a task unless one is running.

        Args:
            run: Runs the task and shows its result, on a thread.
        """
        if self.is_busy:
            self._status.show(f"A {self._name} is running. Stop it first.", "busy")
            return
        self._on_busy(True)
        self._status.show("Preparing ...")
        self._worker.give(partial(self._run, run))

    @contextmanager
    def open_screen(self, folder: Any) -> Iterator[GuidedScreen]:
        """Show a screen in a folder of the panel until the block ends."""
        with self._bench.drawing_lock:
            self.screen = screen = GuidedScreen(
                self._bench.server, folder, self._name.capitalize(), self._bench.drawing_lock
            )
        self._status.show("")
        try:
            yield screen
        finally:
            self.screen = None
            screen.close()

    def close(self) -> None:
        """Stop the task, which can be continued later."""
        if self.screen is not None:
            self.screen.press("q")
        self._worker.wait(_CLOSE_TIMEOUT_S)
        self._worker.close()

    def _run(self, run: Callable[[], None]) -> None:
        try:
            run()
        except Exception as error:  # shown on the page: the studio continues
            self._status.show_error(error, f"The {self._name}")
        self._on_busy(False)
