"""A worker thread that handles the latest value: input often comes faster than results."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestWorker(Generic[T]):
    """Call `work` with the latest item, one at a time, on a thread of this worker.

    An item that is waiting is replaced by the next one, or merged with it. The thread starts with
    the first item.

    Args:
        work: Called with each item on the worker's thread.
        on_error: Called with an exception that `work` raises; the worker continues.
        delay_s: Time without a new item after which the waiting item is handled, such as the
            pause after which a dragged slider is taken to rest.
        merge: Combines a waiting item with a new one; by default the new one replaces it.

    Attributes:
        done_count: Number of items that were handled.
    """

    def __init__(
        self,
        work: Callable[[T], None],
        on_error: Callable[[Exception], None],
        *,
        delay_s: float = 0.0,
        merge: Callable[[T, T], T] = lambda _, new: new,
    ) -> None:
        self._work, self._on_error = work, on_error
        self._delay_s, self._merge = delay_s, merge
        self._changed, self._working = threading.Condition(), threading.Lock()
        self._waiting: list[T] = []  # at most one item
        self._due_at = 0.0  # s of time.monotonic
        self._is_working = self._is_closed = False
        self._thread: threading.Thread | None = None
        self.done_count = 0

    @property
    def is_busy(self) -> bool:
        """Whether an item waits or is being handled."""
        with self._changed:
            return bool(self._waiting) or self._is_working

    @property
    def pending(self) -> T | None:
        """The item that waits to be handled, if any."""
        with self._changed:
            return self._waiting[0] if self._waiting else None

    def give(self, item: T) -> None:
        """Hand over an item and return at once; items after `close` are ignored."""
        with self._changed:
            if self._is_closed:
                return
            self._waiting = [self._merge(self._waiting[0], item) if self._waiting else item]
            self._due_at = time.monotonic() + self._delay_s
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._run, daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def flush(self) -> None:
        """Handle the waiting item now, on the calling thread."""
        with self._working:
            with self._changed:
                if not self._waiting:
                    return
                item, self._waiting, self._is_working = self._waiting[0], [], True
            try:
                self._work(item)
            except Exception as error:  # shown on the page: the studio continues
                if not self._is_closed:  # after that there is no page
                    self._on_error(error)
            finally:
                with self._changed:
                    self.done_count += 1
                    self._is_working = False
                    self._changed.notify_all()

    def wait(self, timeout_s: float) -> bool:
        """Wait until every item is handled; return False after `timeout_s`."""
        with self._changed:
            return self._changed.wait_for(
                lambda: not (self._waiting or self._is_working), timeout_s
            )

    def close(self) -> None:
        """End the thread and drop the waiting item."""
        with self._changed:
            self._is_closed, self._waiting = True, []
            self._changed.notify_all()
            thread = self._thread
        if thread is not None:
            thread.join(5.0)

    def _run(self) -> None:
        while self._wait_until_due():
            self.flush()

    def _wait_until_due(self) -> bool:
        """Wait for an item and its delay; False once the worker is closed."""
        with self._changed:
            while not self._is_closed:
                wait_s = self._due_at - time.monotonic() if self._waiting else None
                if wait_s is not None and wait_s <= 0:
                    return True
                self._changed.wait(wait_s)
            return False
