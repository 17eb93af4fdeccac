"""A terminal taken over: keys one by one, and pages in place of lines."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

from rich.console import Console, Group
from rich.live import Live

from .keys import Keys


class LiveScreen:
    """Enter it before use; the terminal is as before when it is left."""

    #: What a user can do where there is no terminal.
    otherwise = "give --auto"

    def __init__(self) -> None:
        self._console, self._keys = Console(), Keys(self.otherwise)

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

    def _draw(self, pages: Iterable[Group]) -> None:
        """The first of the pages, the richest first, for which the terminal is high enough."""
        self._live.update(fitting(self._console, pages), refresh=True)


def fitting(console: Console, pages: Iterable[Group]) -> Group:
    """The first page that is no higher than the console; of the last one, where none is, the rows
    that fit above its own last row, which names the keys."""
    page = Group()
    for page in pages:
        if _rows(console, page) <= console.height:
            return page
    *rows, last = page.renderables
    room, kept = console.height - _rows(console, Group(last)), []
    for row in rows:
        room -= _rows(console, Group(row))
        if room < 0:
            break
        kept.append(row)
    return Group(*kept, last)


def _rows(console: Console, page: Group) -> int:
    return len(console.render_lines(page, pad=False))
