"""A viser server whose page is for this machine alone.

Viser answers whoever reaches its port, and a browser lends itself to any page that is open in it:
one of another origin could steer a device, or edit a design. So each request tells by its headers
where it comes from, before viser sees it.
"""

from __future__ import annotations

import contextlib
import http
import io
import logging
import socket
import threading
from typing import Any

from ...core.errors import OutputError
from ...core.local_access import Access

HOST = "127.0.0.1"
_making = threading.Lock()  # one at a time, while viser's way to listen is another


def local_page(port: int, label: str) -> Any:
    """The viser server at http://127.0.0.1:`port`. Raises OutputError for a port that is taken, and
    where viser is not installed."""
    try:
        import viser
        import websockets.asyncio.server as sockets
    except ImportError:
        raise OutputError(
            "the page needs viser: install it with pip install 'defsense-fab[live]'"
        ) from None
    _need_free(port)
    for noisy in ("websockets", "viser"):
        logging.getLogger(noisy).setLevel(logging.ERROR)
    access, listen = Access(HOST), sockets.serve

    def guarded(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            host = request.headers.get("Host", "")
            refused = access.refusal(host, request.headers.get_all("Origin"))
            if refused is not None:
                return connection.respond(http.HTTPStatus.FORBIDDEN, refused + "\n")
            return None if process_request is None else process_request(connection, request)

        return listen(*arguments, process_request=answer, **options)

    # It prints its address in a box.
    with _making, contextlib.redirect_stdout(io.StringIO()):
        sockets.serve = guarded  # type: ignore[assignment,misc]
        try:
            server = viser.ViserServer(host=HOST, port=port, label=label, verbose=False)
        finally:
            sockets.serve = listen  # type: ignore[misc]
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    return server


def end_page(server: Any) -> None:
    """Stop it, without what it prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def _need_free(port: int) -> None:
    """Viser takes the next free port without a word; a user would open another program's page."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_STREAM)) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            raise OutputError(
                f"port {port} is taken by another program; give another, as in {port + 10}"
            ) from None
