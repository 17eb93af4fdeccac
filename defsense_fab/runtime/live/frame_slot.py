"""Hand the newest frame from one thread to another."""

from __future__ import annotations

import threading

from ..frames.live_frame import LiveFrame


class FrameSlot:
    """Room for one frame; a newer one replaces it."""

    def __init__(self) -> None:
        self._changed, self._has_ended = threading.Condition(), False
        self._frame: LiveFrame | None = None

    def put(self, frame: LiveFrame) -> None:
        """Replace the waiting frame."""
        with self._changed:
            self._frame = frame
            self._changed.notify()

    def take(self) -> LiveFrame | None:
        """Wait for the next frame; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._has_ended or self._frame is not None)
            frame, self._frame = self._frame, None
            return None if self._has_ended else frame

    def end(self) -> None:
        """Let all further calls of `take` return None."""
        with self._changed:
            self._has_ended = True
            self._changed.notify()
