"""The screen of live calibration: pictures, what is covered, what to do next."""

from __future__ import annotations

from rich.columns import Columns
from rich.console import Group
from rich.text import Text

from ..pipeline.cameras.live_views import BoardShown
from .picture import GREEN, picture
from .screen import LiveScreen

_SHADES = " ░▒▓█"


class BoardTerminal(LiveScreen):
    """Shows a `BoardShown`; enter it before use."""

    def show(self, shown: BoardShown) -> None:
        if shown.flash:
            self._console.bell()
        n = len(shown.images)
        width = max(24, min(72, (self._console.width - 2 * n) // n))
        pictures = []
        for name, image, corners in zip(shown.names, shown.images, shown.corners, strict=True):
            marks = [(corner[None], GREEN) for corner in corners]
            found = f"{len(corners)} corners" if len(corners) else "no board"
            rows = picture(image, width, marks)
            pictures.append(Group(Text(f"{name}: {found}", "bold"), *rows))
        words = Text(f"{shown.taken} of {shown.wanted} views", "bold green")
        parts: list[object] = [Columns(pictures), words]
        if shown.cells is not None:
            most = max(int(shown.cells.max()), 1)
            for row in shown.cells:
                shades = "".join(2 * _SHADES[min(4, -(-4 * int(x) // most))] for x in row)
                parts += [Text(f"  {shades}", "cyan")]
        parts += [Text(f"> {h}", "yellow") for h in shown.hints[:3]]
        parts.append(Text("Enter finish   q stop", "bold"))
        self._draw(Group(*parts))  # type: ignore[arg-type]
