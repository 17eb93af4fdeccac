"""The screen of live calibration: pictures, what is covered, what to do next."""

from __future__ import annotations

import sys

from rich.columns import Columns
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from ..core.errors import DeviceError
from ..pipeline.live_cameras import BoardShown
from .keys import Keys
from .picture import GREEN, picture

_SHADES = " ░▒▓█"


class BoardScreen:
    """Shows a `BoardShown`; enter it before use."""

    def __init__(self) -> None:
        self._console, self._keys = Console(), Keys()

    def __enter__(self) -> BoardScreen:
        if not sys.stdin.isatty():
            raise DeviceError(
                "live cameras are calibrated by keys and a picture, but standard input is no"
                " terminal; run it in one, or give recordings"
            )
        self._keys.__enter__()
        self._live = Live(console=self._console, screen=True, auto_refresh=False)
        self._live.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._live.__exit__(None, None, None)
        self._keys.__exit__(None, None, None)

    def key(self, timeout: float) -> str | None:
        return self._keys.get(timeout)

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
                parts.append(
                    Text("  " + "".join(2 * _SHADES[min(4, -(-4 * int(x) // most))] for x in row),
                         "cyan")
                )  # fmt: skip
        parts += [Text(f"> {h}", "yellow") for h in shown.hints[:3]]
        parts.append(Text("Enter finish   q stop", "bold"))
        self._live.update(Group(*parts), refresh=True)  # type: ignore[arg-type]
