"""Serve viser pages to this machine alone, or to everyone who has the link with its token.

Viser answers every request that reaches its port, and browsers send requests on behalf of any page
that is open in them: a page of another origin could steer a device or edit a design. So each
request is checked by its headers before viser sees it. Texts on a page are never taken for HTML,
because names and messages come from the files of others.
"""

from __future__ import annotations

import contextlib
import http
import io
import logging
import re
import threading
from pathlib import Path
from typing import Any

from ...core.errors import OutputError
from ...core.machine.local_access import Access
from ...core.machine.optional_libraries import optional
from .page_guard import check_free, set_cookie, token_refusal

#: The address at which pages are served to this machine alone.
HOST = "127.0.0.1"
#: Clients that send invalid data are closed; tracebacks of that help nobody.
_socket_log = logging.getLogger(f"{__name__}.sockets")
_patch_lock = threading.Lock()  # held while viser's function to listen is replaced

_WORD_JOINER = "\u2060"  # invisible; it separates what would be a tag or an image
_TAG_OR_IMAGE = re.compile(r"<(?=[A-Za-z/!?])|!(?=\[)")


def escape_markdown(markdown: str, image_root: Path | None = None) -> str:  # noqa: ARG001 - viser's
    """Return Markdown in which HTML tags and images are shown as text.

    Viser renders HTML in Markdown as it is, scripts included, and reads the files that images name.
    But a device that is called `<script>` must not run.

    Args:
        markdown: The text.
        image_root: Not used; viser passes it.
    """
    return _TAG_OR_IMAGE.sub(lambda match: match[0] + _WORD_JOINER, markdown)


def serve_page(port: int, label: str, access: Access | None = None, host: str = HOST) -> Any:
    """Start a viser server at http://`host`:`port`.

    Args:
        port: The port.
        label: Title of the page.
        access: Who may open it; by default this machine alone.
        host: Address to listen on.

    Returns:
        The `viser.ViserServer`.

    Raises:
        OutputError: The port is in use, the host is not an address of this machine, or viser is not
            installed.
    """
    with optional(OutputError, "the page", "live"):
        import viser
        import websockets.asyncio.server as sockets
        from viser import _gui_handles, _messages
    check_free(host, port)
    for logger in ("websockets", "viser"):
        logging.getLogger(logger).setLevel(logging.ERROR)
    _socket_log.setLevel(logging.CRITICAL)
    original = sockets.serve
    guarded = _guard(original, access or Access(host), port)
    # Viser prints its address in a box.
    with _patch_lock, contextlib.redirect_stdout(io.StringIO()):
        sockets.serve = guarded  # type: ignore[misc]
        try:
            server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
        finally:
            sockets.serve = original  # type: ignore[misc]
    _gui_handles._parse_markdown = escape_markdown
    # Any page could request a tunnel to an external server, which would publish it.
    for request in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(request)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    return server


def _guard(listen: Any, access: Access, port: int) -> Any:
    """Wrap the function that listens, so that it refuses requests without access."""

    def guarded(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            headers = request.headers
            reason = access.refusal(
                ", ".join(headers.get_all("Host")), headers.get_all("Origin")
            ) or token_refusal(access, port, request.path, headers.get_all("Cookie"))
            if reason is not None:
                return connection.respond(http.HTTPStatus.FORBIDDEN, reason + "\n")
            response = None if process_request is None else process_request(connection, request)
            if response is not None:
                set_cookie(access, port, response.headers)
            return response

        return listen(*arguments, process_request=answer, logger=_socket_log, **options)

    return guarded


def close_page(server: Any) -> None:
    """Stop a viser server, without the text that it prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()
