"""Full-screen display of a terminal, with single keys."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

from rich.console import Console, Group
from rich.live import Live

from .keys import Keys


class LiveScreen:
    """Full-screen display; use it as a context manager, which restores the terminal.

    Attributes:
        otherwise: What the user can do without a terminal.
    """

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
        """Return the next key, as `Keys.get` does."""
        return self._keys.get(timeout)

    def _draw(self, pages: Iterable[Group]) -> None:
        """Show the first of the pages, the most detailed first, that fits the terminal."""
        self._live.update(fitting(self._console, pages), refresh=True)


def fitting(console: Console, pages: Iterable[Group]) -> Group:
    """Return the first page that fits the height of the console.

    If none fits, return the rows of the last page that fit above its last row, which lists the
    keys.
    """
    page = Group()
    for page in pages:
        if _rows(console, page) <= console.height:
            return page
    *rows, last = page.renderables
    free_rows, kept = console.height - _rows(console, Group(last)), []
    for row in rows:
        free_rows -= _rows(console, Group(row))
        if free_rows < 0:
            break
        kept.append(row)
    return Group(*kept, last)


def _rows(console: Console, page: Group) -> int:
    return len(console.render_lines(page, pad=False))
