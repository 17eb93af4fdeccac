"""Virtual serial ports: a simulated read-out board that other code opens by its port's name."""

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

POLL_S = 0.005  # between looks at the board for new data
MAX_BUFFERED = 4096  # bytes that wait for a slow reader
JOIN_TIMEOUT_S = 2.0


class SocketPort:
    """A local socket with a simulated board, for systems without pseudo-terminals.

    It serves one program at a time, until it is closed.

    Args:
        board: The simulated board.

    Attributes:
        port: Address to open, such as `socket://127.0.0.1:50123`.
    """

    def __init__(self, board: ReadoutTwin) -> None:
        self._board, self._stop = board, threading.Event()
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.1)
        self.port = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close the socket and stop the thread."""
        self._stop.set()
        self._thread.join(JOIN_TIMEOUT_S)
        self._server.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            # `accept` times out without a client; a client may disconnect at any time.
            with contextlib.suppress(OSError), self._server.accept()[0] as connection:
                self._serve(connection)

    def _serve(self, connection: socket.socket) -> None:
        while not self._stop.is_set():
            if select.select([connection], [], [], POLL_S)[0]:
                received = connection.recv(1024)
                if not received:
                    return
                self._board.write(received)
            if self._board.in_waiting:
                connection.sendall(self._board.read(4096))


if sys.platform == "win32":
    VirtualPort = SocketPort
else:

    class PseudoTerminal:
        """A pseudo-terminal with a simulated board, until it is closed.

        Args:
            board: The simulated board.

        Attributes:
            port: Name to open, such as `/dev/pts/3`.
        """

        def __init__(self, board: ReadoutTwin) -> None:
            import pty
            import tty

            self._board = board
            self._master, self._slave = pty.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self.port = os.ttyname(self._slave)
            self._stop = threading.Event()
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()

        def close(self) -> None:
            """Close the terminal and stop the thread."""
            self._stop.set()
            self._thread.join(JOIN_TIMEOUT_S)
            for end in (self._master, self._slave):
                with contextlib.suppress(OSError):
                    os.close(end)

        def _run(self) -> None:
            unsent = b""
            while not self._stop.is_set():
                readable, _, _ = select.select([self._master], [], [], POLL_S)
                with contextlib.suppress(OSError):
                    if readable:
                        self._board.write(os.read(self._master, 1024))
                if len(unsent) < MAX_BUFFERED and self._board.in_waiting:
                    unsent += self._board.read(4096)
                if unsent:
                    with contextlib.suppress(BlockingIOError):
                        unsent = unsent[os.write(self._master, unsent) :]

    VirtualPort = PseudoTerminal


def open_virtual_port(board: ReadoutTwin) -> VirtualPort:
    """Return a virtual port of a simulated board; open its `port` like a serial port."""
    return VirtualPort(board)
