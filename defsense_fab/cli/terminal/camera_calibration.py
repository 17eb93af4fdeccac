"""Display of live camera calibration: pictures, coverage, and hints."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from typing import Self

from rich.columns import Columns
from rich.console import Group
from rich.text import Text

from ...workflow.cameras.live_views import BoardShown
from .picture import GREEN, picture
from .screen import LiveScreen

_SHADES = " ░▒▓█"


class BoardTerminal(LiveScreen):
    """Full-screen display of the calibration; use it as a context manager."""

    otherwise = "give videos or pictures of the board"

    def show(self, shown: BoardShown) -> None:
        if shown.flash:
            self._console.bell()
        self._draw(pages(shown, self._console.width))


class BoardLines:
    """Display of the calibration as plain lines, for logs and programs; it reads no keys."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Do nothing: the terminal was not changed."""

    def show(self, shown: BoardShown) -> None:
        if shown.flash:
            more = f"; {shown.hints[0]}" if shown.taken < shown.wanted and shown.hints else ""
            sys.stderr.write(
                f"{', '.join(shown.names)}: {shown.taken} of {shown.wanted} views{more}\n"
            )

    def key(self, timeout: float) -> str | None:
        time.sleep(timeout)
        return None


def pages(shown: BoardShown, width: int) -> Iterator[Group]:
    """Return pages `width` characters wide, with smaller and smaller pictures."""
    n = max(len(shown.images), 1)
    picture_width = max(24, min(72, (width - 2 * n) // n))
    for scale in (1.0, 0.75, 0.55, 0.4):
        pictures = []
        for name, image, corners in zip(shown.names, shown.images, shown.corners, strict=True):
            marks = [(corner[None], GREEN) for corner in corners]
            found = f"{len(corners)} corners" if len(corners) else "no board"
            rows = picture(image, max(round(scale * picture_width), 20), marks)
            pictures.append(Group(Text(f"{name}: {found}", "bold"), *rows))
        words = Text(f"{shown.taken} of {shown.wanted} views", "bold green")
        parts: list[object] = [Columns(pictures), words]
        if shown.cells is not None:
            max_count = max(int(shown.cells.max()), 1)
            for row in shown.cells:
                shades = "".join(2 * _SHADES[min(4, -(-4 * int(x) // max_count))] for x in row)
                parts += [Text(f"  {shades}", "cyan")]
        parts += [Text(f"> {h}", "yellow") for h in shown.hints[:3]]
        parts.append(Text("Enter finish   q stop", "bold"))
        yield Group(*parts)  # type: ignore[arg-type]
