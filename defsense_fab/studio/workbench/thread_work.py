"""Work on a thread of its own, one at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


class ThreadWork:
    """What has such work: begin it, and see whether it is there."""

    _thread: threading.Thread | None = None

    @property
    def busy(self) -> bool:
        """Whether some is prepared, under way, or being ended."""
        thread = self._thread
        return thread is not None and thread.is_alive()

    def begin(self, work: Callable[..., None], *given: Any) -> None:
        """On a thread that ends with the program."""
        self._thread = threading.Thread(target=work, args=given, daemon=True)
        self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Whether there is none any more within so many s."""
        thread = self._thread
        if thread is not None:
            thread.join(seconds)
        return not self.busy
