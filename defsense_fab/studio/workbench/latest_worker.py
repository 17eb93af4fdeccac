"""Work on the newest of what comes: a person drags faster than anything can be computed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """Calls `work` with the newest thing that was given, one at a time, on a thread of its own;
    `failed` takes what it raises."""

    def __init__(self, work: Callable[[T], None], failed: Callable[[Exception], None]) -> None:
        self._work, self._failed = work, failed
        self._changed, self._things = threading.Condition(), list[T]()
        self._busy = self._over = False
        self.done = 0  # how often work was done
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def give(self, thing: T) -> None:
        """From any thread; returns at once."""
        with self._changed:
            self._things = [thing]
            self._changed.notify_all()

    def wait(self, seconds: float) -> bool:
        """Whether all that was given is done within so many s."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._things or self._busy), seconds)

    def close(self) -> None:
        """End the thread; what has not begun is left."""
        with self._changed:
            self._over = True
            self._changed.notify_all()
        self._thread.join(5.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._over or bool(self._things))
                if self._over:
                    return
                thing, self._things, self._busy = self._things[0], [], True
            try:
                self._work(thing)
            except Exception as error:  # told on the page: the studio goes on
                if self._over:  # and there is no page any more
                    return
                self._failed(error)
            self.done += 1
