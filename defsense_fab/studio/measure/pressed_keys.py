"""Buttons in place of the keys that a guided routine asks for."""

from __future__ import annotations

import queue


class PressedKeys:
    """From any thread to the routine's."""

    def __init__(self) -> None:
        self._keys = queue.SimpleQueue[str]()

    def press(self, key: str) -> None:
        """As on a keyboard: enter, q and so on."""
        self._keys.put(key)

    def key(self, timeout: float) -> str | None:
        """The next one; None where none comes within so many s."""
        try:
            return self._keys.get(timeout=timeout)
        except queue.Empty:
            return None
