"""A pseudo-terminal with the read-out board's twin behind it, which is opened as a serial port
is."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import threading
from typing import TYPE_CHECKING

assert sys.platform != "win32"  # `SocketLine` is for Windows

if TYPE_CHECKING:
    from .readout_twin import ReadoutTwin

_WAIT = 0.005  # s between looks at the read-out board


class PseudoTerminal:
    """Carries bytes between a read-out board and `port`, a name such as /dev/pts/3, until it is
    closed."""

    def __init__(self, board: ReadoutTwin) -> None:
        import pty
        import tty

        self._board = board
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hang up."""
        self._over.set()
        self._thread.join(2)
        for end in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(end)

    def _run(self) -> None:
        waiting = b""
        while not self._over.is_set():
            heard, _, _ = select.select([self._master], [], [], _WAIT)
            with contextlib.suppress(OSError):
                if heard:
                    self._board.write(os.read(self._master, 1024))
            if len(waiting) < 4096 and self._board.in_waiting:
                waiting += self._board.read(4096)
            if waiting:
                with contextlib.suppress(BlockingIOError):
                    waiting = waiting[os.write(self._master, waiting) :]
