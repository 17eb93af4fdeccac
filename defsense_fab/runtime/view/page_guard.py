"""Guard a page's port: its token, the cookie that holds it, and whether the port is free."""

from __future__ import annotations

import contextlib
import errno
import socket
from http.cookies import CookieError, SimpleCookie
from typing import Any

from ...core.errors import OutputError
from ...core.machine.local_access import LOCAL_HOSTS, Access


def check_free(host: str, port: int) -> None:
    """Raise OutputError for a busy port, on which the user would open another program's page."""
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


# The page opens its socket at an address without the token. So the token is kept in a cookie, which
# the browser sends along.


def token_refusal(access: Access, port: int, path: str, cookies: list[str]) -> str | None:
    """Return why a request is refused; None if it has the token, or needs none."""
    if access.has_token(path) or any(access.is_token(v) for v in _cookie_values(cookies, port)):
        return None
    return "open the link that `defsense studio` prints: it ends with the token"


def set_cookie(access: Access, port: int, headers: Any) -> None:
    """Add the token to an answer.

    The cookie is for this page alone, hidden from scripts, and never sent from pages of others.
    Links on the page do not reveal the token.
    """
    if access.token:
        name = _cookie_name(port)
        headers["Set-Cookie"] = f"{name}={access.token}; Path=/; HttpOnly; SameSite=Strict"
        headers["Referrer-Policy"] = "no-referrer"


def _cookie_values(cookies: list[str], port: int) -> list[str]:
    values = []
    for text in cookies:
        try:
            cookie = SimpleCookie(text).get(_cookie_name(port))
        except CookieError:
            continue
        if cookie is not None:
            values.append(cookie.value)
    return values


def _cookie_name(port: int) -> str:
    """Return a name with the port: cookies of two pages on one machine would replace each other."""
    return f"defsense-{port}"
