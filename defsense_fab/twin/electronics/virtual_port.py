"""The line on which the read-out board's twin speaks, as the system has it."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .readout_board import ReadoutTwin

# A pseudo-terminal with the read-out board's twin behind it, which is opened as a serial port
# is.

assert sys.platform != "win32"  # `SocketPort` is for Windows


_WAIT_PSEUDO_TERMINAL = 0.005  # s between looks at the read-out board


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
            heard, _, _ = select.select([self._master], [], [], _WAIT_PSEUDO_TERMINAL)
            with contextlib.suppress(OSError):
                if heard:
                    self._board.write(os.read(self._master, 1024))
            if len(waiting) < 4096 and self._board.in_waiting:
                waiting += self._board.read(4096)
            if waiting:
                with contextlib.suppress(BlockingIOError):
                    waiting = waiting[os.write(self._master, waiting) :]


# A local socket with the read-out board's twin behind it, where there are no pseudo-terminals.

_WAIT = 0.005  # s between looks at the read-out board


class SocketPort:
    """Carries bytes between a read-out board and `port`, an address such as
    socket://127.0.0.1:50123, until it is closed. One program at a time is served."""

    def __init__(self, board: ReadoutTwin) -> None:
        self._board, self._over = board, threading.Event()
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.1)
        self.port = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hang up."""
        self._over.set()
        self._thread.join(2)
        self._server.close()

    def _run(self) -> None:
        while not self._over.is_set():
            # Nobody came yet, or who came has left.
            with contextlib.suppress(OSError), self._server.accept()[0] as line:
                self._carry(line)

    def _carry(self, line: socket.socket) -> None:
        while not self._over.is_set():
            if select.select([line], [], [], _WAIT)[0]:
                heard = line.recv(1024)
                if not heard:
                    return
                self._board.write(heard)
            if self._board.in_waiting:
                line.sendall(self._board.read(4096))


if sys.platform == "win32":
    VirtualPort = SocketPort
else:
    VirtualPort = PseudoTerminal


def open_virtual_port(board: ReadoutTwin) -> VirtualPort:
    """A line with `board` behind it; its `port` is opened as a serial port is."""
    return VirtualPort(board)
