"""Decide who may use a server: pages of this machine, and clients that have the token."""

from __future__ import annotations

import secrets
import socket
from urllib.parse import parse_qs, urlsplit

#: Names of this machine for itself.
LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")
_ANY_HOST = ("0.0.0.0", "::")  # noqa: S104  # compared, not bound
_HTTP_PORT = 80
_DOCUMENTATION_ADDRESS = ("192.0.2.1", 9)  # reserved for documentation: nothing answers


class Access:
    """Access rules of a server.

    A server for this machine alone needs no token. But a browser also sends requests on behalf of
    foreign pages, so the request's `Origin` must be this machine's. Its `Host` must be, too, since
    a foreign name may be made to resolve to this machine. A server for other machines needs the
    token.

    Args:
        host: Address at which the server listens.
        token: A custom token; by default a random one, where one is needed.

    Attributes:
        local: Whether the server listens for this machine alone.
        token: The token; empty where none is needed.
    """

    def __init__(self, host: str, token: str = "") -> None:
        self._host, self.local = host, host in LOCAL_HOSTS
        self.token = token or ("" if self.local else secrets.token_urlsafe(16))

    def link(self, port: int) -> str:
        """Return the link to open in a browser.

        For other machines it has the address of this machine in its network, and the token.

        Args:
            port: Port at which the server listens.
        """
        name = _own_address() if self._host in _ANY_HOST else self._host
        bracketed = f"[{name}]" if ":" in name else name
        return f"http://{bracketed}:{port}/" + (f"?token={self.token}" if self.token else "")

    def refusal(self, host: str, origins: list[str], *, any_port: bool = True) -> str | None:
        """Return why a request is refused, or None.

        Args:
            host: The request's `Host` header.
            origins: Its `Origin` headers.
            any_port: Whether pages that other programs of this machine serve are accepted.
        """
        if self.local and _host_name(f"//{host}") not in LOCAL_HOSTS:
            return f"this server listens on this machine only, and not by the name {host[:80]!r}"
        for origin in origins:
            is_same = not self.local and origin.split("://", 1)[-1].lower() == host.lower()
            is_own = any_port or _port(origin) == _port(f"//{host}")
            if not (_host_name(origin) in LOCAL_HOSTS and is_own) and not is_same:
                return f"pages of {origin[:80]!r} may not read this"
        return None

    def has_token(self, path: str) -> bool:
        """Return whether a request's path has the token, or none is needed."""
        if not self.token:
            return True
        try:
            given = parse_qs(urlsplit(path).query).get("token", [""])
        except ValueError:
            return False
        return self.is_token(given[0])

    def is_token(self, text: str) -> bool:
        """Return whether a text is the token, in constant time."""
        return secrets.compare_digest(text.encode(errors="replace"), self.token.encode())


def _host_name(url: str) -> str:
    if "@" in url:  # no browser sends a user's name with `Host` or `Origin`
        return ""
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


def _port(url: str) -> int:
    try:
        return urlsplit(url).port or _HTTP_PORT
    except ValueError:
        return -1


def _own_address() -> str:
    """Return this machine's address in its network, or its name if it is in none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(_DOCUMENTATION_ADDRESS)  # nothing is sent
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()
