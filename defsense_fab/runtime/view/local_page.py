"""A viser server whose page is for this machine alone, or for whoever has the link with its token.

Viser answers whoever reaches its port, and a browser lends itself to any page that is open in it:
one of another origin could steer a device, or edit a design. So each request tells by its headers
where it comes from, before viser sees it. What a page says is never taken for HTML: names and
messages come from files of others.
"""

from __future__ import annotations

import contextlib
import errno
import http
import io
import logging
import re
import socket
import threading
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any

from ...core.errors import OutputError
from ...core.machine.local_access import LOCAL_HOSTS, Access
from ...core.machine.optional_libraries import optional

# Markdown of viser's pages without HTML.
#
# Viser renders HTML in markdown as it is, scripts included, and reads the files that images name. But
# names of devices and messages of errors come from folders of others: a device that is called
# `<script>` must not run.

_JOIN = "\u2060"  # is not seen, and parts what would be a tag or an image
_BEGINS = re.compile(r"<(?=[A-Za-z/!?])|!(?=\[)")


def plain_markdown(markdown: str, image_root: Path | None = None) -> str:  # noqa: ARG001 - viser's
    """The text with tags and images to be read, not followed."""
    return _BEGINS.sub(lambda found: found[0] + _JOIN, markdown)


# The token of a page's link, kept in a cookie: the page opens its socket at an address without
# the token, and a browser sends the cookie along.


def refusal(access: Access, port: int, path: str, cookies: list[str]) -> str | None:
    """Why a request with this path and these Cookie headers is refused; None where it has the
    token in one of them, or none is needed."""
    if access.has_token(path) or any(access.is_token(v) for v in _values(cookies, port)):
        return None
    return "open the link that `defsense studio` prints: it ends with the token"


def give(access: Access, port: int, headers: Any) -> None:
    """Put the token into an answer: for this page alone, unseen by scripts, never sent along from
    pages of others. Links that the page leads to do not tell it."""
    if access.token:
        headers["Set-Cookie"] = f"{_name(port)}={access.token}; Path=/; HttpOnly; SameSite=Strict"
        headers["Referrer-Policy"] = "no-referrer"


def _values(cookies: list[str], port: int) -> list[str]:
    out = []
    for text in cookies:
        try:
            found = SimpleCookie(text).get(_name(port))
        except CookieError:
            continue
        if found is not None:
            out.append(found.value)
    return out


def _name(port: int) -> str:
    """Cookies do not know ports: two pages of one machine would take each other's."""
    return f"defsense-{port}"


HOST = "127.0.0.1"
#: No answer of the network is needed for it: an address that is reserved for documentation.
_ELSEWHERE = ("192.0.2.1", 9)
#: A client that sends what viser cannot read is closed; a traceback of that helps nobody.
_sockets = logging.getLogger(f"{__name__}.sockets")
_making = threading.Lock()  # one at a time, while viser's way to listen is another


def local_page(port: int, label: str, access: Access | None = None, host: str = HOST) -> Any:
    """The viser server at http://`host`:`port`, where `access` says who may see it (this machine).
    Raises OutputError for a port that is taken, an address that this machine has not, and where
    viser is not installed."""
    with optional(OutputError, "the page", "live"):
        import viser
        import websockets.asyncio.server as sockets
        from viser import _gui_handles, _messages
    _need_free(host, port)
    for noisy in ("websockets", "viser"):
        logging.getLogger(noisy).setLevel(logging.ERROR)
    _sockets.setLevel(logging.CRITICAL)
    entry, listen = access or Access(host), sockets.serve

    def guarded(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            headers = request.headers
            refused = entry.refusal(
                ", ".join(headers.get_all("Host")), headers.get_all("Origin")
            ) or refusal(entry, port, request.path, headers.get_all("Cookie"))
            if refused is not None:
                return connection.respond(http.HTTPStatus.FORBIDDEN, refused + "\n")
            response = None if process_request is None else process_request(connection, request)
            if response is not None:
                give(entry, port, response.headers)
            return response

        return listen(*arguments, process_request=answer, logger=_sockets, **options)

    # It prints its address in a box.
    with _making, contextlib.redirect_stdout(io.StringIO()):
        sockets.serve = guarded  # type: ignore[assignment,misc]
        try:
            server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
        finally:
            sockets.serve = listen  # type: ignore[misc]
    _gui_handles._parse_markdown = plain_markdown
    # Any page could ask for a tunnel to a server elsewhere, which shows it to the world.
    for asked in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(asked)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    return server


def page_link(host: str, port: int, access: Access) -> str:
    """What to open in a browser: for other machines by this one's address, and with the token."""
    name = host
    if host in ("0.0.0.0", "::"):  # noqa: S104 - what was asked for, not what is chosen
        name = _address()
    shown = f"[{name}]" if ":" in name else name
    token = f"?token={access.token}" if access.token else ""
    return f"http://{shown}:{port}/{token}" if token else f"http://{shown}:{port}"


def end_page(server: Any) -> None:
    """Stop it, without what it prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def _address() -> str:
    """This machine's address in its network; its name where it is in none."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        try:
            probe.connect(_ELSEWHERE)  # nothing is sent
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()


def _need_free(host: str, port: int) -> None:
    """Viser takes the next free port without a word; a user would open another program's page."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
    except OSError:
        raise _no_address(host) from None
    with contextlib.closing(socket.socket(family, socket.SOCK_STREAM)) as probe:
        # On Windows SO_REUSEADDR would share the port of another program.
        option = getattr(socket, "SO_EXCLUSIVEADDRUSE", socket.SO_REUSEADDR)
        probe.setsockopt(socket.SOL_SOCKET, option, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            if host not in LOCAL_HOSTS and error.errno == errno.EADDRNOTAVAIL:
                raise _no_address(host) from None
            raise OutputError(
                "is in use by another program",
                code="port-busy",
                where=f"port {port}",
                action=f"Choose another port, such as {port + 10}",
                port=port,
            ) from None


def _no_address(host: str) -> OutputError:
    return OutputError(
        "this machine has no such address",
        code="address-unavailable",
        where=f"host {host}",
        action="Use an address of this machine, or 0.0.0.0",
        host=host,
    )
