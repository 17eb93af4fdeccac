"""The line on which the read-out board's twin speaks, as the system has it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from .socket_line import SocketLine

if sys.platform == "win32":
    TwinLine = SocketLine
else:
    from .pseudo_terminal import PseudoTerminal

    TwinLine = PseudoTerminal

if TYPE_CHECKING:
    from .readout_twin import ReadoutTwin


def open_line(board: ReadoutTwin) -> TwinLine:
    """A line with `board` behind it; its `port` is opened as a serial port is."""
    return TwinLine(board)
