"""The solver of poses, shared by all browsers and by work in the background."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from ....core.errors import DefsenseError
from ....workflow.design.pose_preview import PosePreview, PreviewedPose
from .preview_work import PreviewAnswer, PreviewRequest, PreviewWork

T = TypeVar("T")
#: Owner of the work that waits for everything else.
BACKGROUND = "background"


class SolverTask(Generic[T]):
    """A longer action on the solver's thread, whose result another thread waits for.

    Args:
        action: Called with the preview and a function that returns whether to stop.
    """

    def __init__(self, action: Callable[[PosePreview, Callable[[], bool]], T]) -> None:
        self._action = action
        self._ended, self._stopped = threading.Event(), threading.Event()
        self._result: list[T] = []
        self._error: Exception | None = None

    @property
    def is_stopped(self) -> bool:
        """Whether the task was stopped or dropped."""
        return self._stopped.is_set()

    def __call__(self, preview: PosePreview) -> None:
        try:
            if not self.is_stopped:
                self._result = [self._action(preview, self._stopped.is_set)]
        except Exception as error:  # raised again on the thread that waits
            self._error = error
        finally:
            self._ended.set()

    def stop(self) -> None:
        """Let the action end early."""
        self._stopped.set()

    def drop(self) -> None:
        """End a task that has not started."""
        self._stopped.set()
        self._ended.set()

    def finish(self) -> None:
        """End a task that has run, or that no body has taken."""
        self._ended.set()

    def result(self) -> T:
        """Wait for the result. Raises DefsenseError if the task failed or was stopped."""
        self._ended.wait()
        if self._error is not None:
            raise self._error
        if self.is_stopped or not self._result:
            raise DefsenseError("the solver was stopped", code="canceled")
        return self._result[0]


Item = PreviewRequest | SolverTask[Any]


class PoseQueue:
    """Hand the latest item of each owner to the solver, in turn.

    An owner's newer item replaces one that waits, and ends one that runs. Work in the background
    ends whenever an item of another owner arrives.

    Args:
        on_answer: As of PreviewWork.
        on_solved: As of PreviewWork.
        on_error: Called with a request that failed and its error.
    """

    def __init__(
        self,
        on_answer: Callable[[PreviewRequest, PreviewAnswer], None],
        on_solved: Callable[[PosePreview, PreviewRequest, PreviewedPose], None],
        on_error: Callable[[PreviewRequest | None, Exception], None],
    ) -> None:
        self._on_error = on_error
        self._lock = threading.Lock()
        self._idle = threading.Condition(self._lock)
        self._waiting: dict[object, Item] = {}
        self._running: tuple[object, Item] | None = None
        self._last: Item | None = None
        self._is_closed = False
        self.work = PreviewWork(on_answer, on_solved, self._fail, self._take_next)

    @property
    def is_idle(self) -> bool:
        """Whether nothing runs or waits."""
        return self._running is None

    def give(self, owner: object, item: Item) -> None:
        """Add an item and return at once."""
        with self._lock:
            if self._is_closed:
                if isinstance(item, SolverTask):
                    item.drop()
                return
            replaced = self._waiting.pop(owner, None)
            if isinstance(replaced, SolverTask):
                replaced.drop()
            self._waiting[owner] = item
            if self._running is None:
                self._start()
            elif self._running[0] in (owner, BACKGROUND):
                self._end_early()

    def drop(self, owner: object) -> None:
        """Forget the items of an owner."""
        with self._lock:
            dropped = self._waiting.pop(owner, None)
            if isinstance(dropped, SolverTask):
                dropped.drop()
            if self._running is not None and self._running[0] == owner:
                self._end_early()

    def cancel(self, owner: object) -> None:
        """Cancel the running item of an owner; the last shape stays."""
        with self._lock:
            if self._running is not None and self._running[0] == owner:
                self._end_early(is_canceled=True)

    def wait(self, timeout_s: float) -> bool:
        """Wait until nothing runs or waits; return False after `timeout_s`."""
        with self._idle:
            return self._idle.wait_for(lambda: self._running is None, timeout_s)

    def close(self) -> None:
        """Drop all items and end the thread."""
        with self._lock:
            self._is_closed = True
            for item in self._waiting.values():
                if isinstance(item, SolverTask):
                    item.drop()
            self._waiting.clear()
            self._end_early()
        self.work.close()

    def _start(self) -> None:
        """Start the next item; work in the background is the last."""
        if not self._waiting:
            self._running = None
            self._idle.notify_all()
            return
        owner = next((o for o in self._waiting if o != BACKGROUND), BACKGROUND)
        item = self._waiting.pop(owner)
        self._running = owner, item
        if isinstance(item, SolverTask):
            self.work.call(item)
        else:
            self.work.give(item)

    def _end_early(self, *, is_canceled: bool = False) -> None:
        if self._running is None:
            return
        item = self._running[1]
        if isinstance(item, SolverTask):
            item.stop()
        elif is_canceled:
            self.work.cancel()
        else:
            self.work.supersede()

    def _take_next(self) -> None:
        with self._lock:
            self._last = None if self._running is None else self._running[1]
            if isinstance(self._last, SolverTask):
                self._last.finish()
            self._start()

    def _fail(self, error: Exception) -> None:
        self._on_error(self._last if isinstance(self._last, PreviewRequest) else None, error)
