"""A local socket with the read-out board's twin behind it, where there are no pseudo-terminals."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .readout_twin import ReadoutTwin

_WAIT = 0.005  # s between looks at the read-out board


class SocketLine:
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
