"""Values that a hand is still changing: a slider tells of every place that it passes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

QUIET = 0.4  # s without another value, after which the hand is taken to have come to rest


class Settled:
    """Calls `work(values)` with the last value of each key, once nothing has come for a while, on
    a thread of its own; `failed` takes what it raises."""

    def __init__(
        self,
        work: Callable[[dict[str, Any]], None],
        failed: Callable[[Exception], None],
        quiet: float = QUIET,
    ) -> None:
        self._work, self._failed, self._quiet = work, failed, quiet
        self._lock, self._doing = threading.Lock(), threading.Lock()
        self._values: dict[str, Any] = {}
        self._timer: threading.Timer | None = None

    def give(self, key: str, value: Any) -> None:
        """From any thread; returns at once."""
        with self._lock:
            self._values[key] = value
            if self._timer is not None:
                self._timer.cancel()
            self._timer = threading.Timer(self._quiet, self.flush)
            self._timer.daemon = True
            self._timer.start()

    def pending(self, key: str) -> bool:
        """Whether a value of it is still to be taken up."""
        with self._lock:
            return key in self._values

    def flush(self) -> None:
        """Take up now what has come."""
        with self._doing:
            with self._lock:
                values, self._values = self._values, {}
            if values:
                try:
                    self._work(values)
                except Exception as error:  # told on the page: the studio goes on
                    self._failed(error)

    def close(self) -> None:
        """Nothing is lost: what has come is taken up."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
        self.flush()
