"""A terminal taken over: keys one by one, and pages in place of lines."""

from __future__ import annotations

from typing import Self

from rich.console import Console, Group
from rich.live import Live

from .keys import Keys


class LiveScreen:
    """Enter it before use; the terminal is as before when it is left."""

    def __init__(self) -> None:
        self._console, self._keys = Console(), Keys()

    def __enter__(self) -> Self:
        self._keys.__enter__()
        self._live = Live(console=self._console, screen=True, auto_refresh=False)
        self._live.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._live.__exit__(None, None, None)
        self._keys.__exit__(None, None, None)

    def key(self, timeout: float) -> str | None:
        """As `Keys.get`."""
        return self._keys.get(timeout)

    def _draw(self, page: Group) -> None:
        self._live.update(page, refresh=True)
