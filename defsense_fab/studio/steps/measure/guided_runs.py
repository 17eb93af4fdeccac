"""Run one guided task at a time on a thread, with its screen on the page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ....core.errors import DefsenseError
from ....workflow.view import Client, GuidedScreen, WebServer, live_messages
from ...background.latest_worker import LatestWorker
from .status_board import StatusBoard, TaskName

_CLOSE_TIMEOUT_S = 10.0  # time in which a guided run has to end


class GuidedRuns:
    """Runs one guided task at a time, of all kinds.

    Args:
        server: Sends the state of the run to the browsers.
        board: Shows what the task does.
        on_end: Called once a task has ended.

    Attributes:
        screen: The screen of the running task, or None.
    """

    def __init__(self, server: WebServer, board: StatusBoard, on_end: Callable[[], None]) -> None:
        self._server, self._board, self._on_end = server, board, on_end
        self._worker = LatestWorker[Callable[[], None]](lambda work: work(), lambda _: None)
        self.screen: GuidedScreen | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a task is prepared, runs or ends."""
        return self._worker.is_busy

    def wait(self, timeout_s: float) -> bool:
        """Wait until no task runs; return False after `timeout_s`."""
        return self._worker.wait(timeout_s)

    def require_idle(self) -> None:
        """Raise a DefsenseError (`busy`) if a task is prepared, runs or ends."""
        if self.is_busy:
            raise DefsenseError("another guided run is open", code="busy", action="Stop it first")

    def start(self, name: TaskName, run: Callable[[], None]) -> None:
        """Start a task.

        Args:
            name: The task, whose status is shown.
            run: Runs the task and shows its result, on a thread.

        Raises:
            DefsenseError: Another task is running (`busy`).
        """
        self.require_idle()
        self._board.show(name, "Preparing ...", state="running")
        self._worker.give(lambda: self._run(name, run))

    @contextmanager
    def open_screen(self, name: TaskName, title: str) -> Iterator[GuidedScreen]:
        """Show a screen on the page until the block ends."""
        self.screen = screen = GuidedScreen(self._server, title)
        self._board.show(name, "", state="running")
        try:
            yield screen
        finally:
            self.screen = None
            screen.close()

    def press(self, client: Client, request: live_messages.PressKey) -> None:
        """Press a key of the running task; ignored if none runs."""
        screen = self.screen
        if screen is not None:
            screen.handle_key(client, request)

    def stop(self) -> None:
        """Stop the running task, which can be continued later."""
        screen = self.screen
        if screen is not None:
            screen.press("q")

    def close(self) -> None:
        """Stop the task and end the thread."""
        self.stop()
        self._worker.wait(_CLOSE_TIMEOUT_S)
        self._worker.close()

    def _run(self, name: TaskName, run: Callable[[], None]) -> None:
        try:
            run()
        except Exception as error:  # shown on the page: the studio continues
            self._board.show(name, "", error=error)
        self._on_end()
