"""URLs of boards with Wi-Fi: `udp://` or `tcp://`, and a host or the name of a paired board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn
from urllib.parse import parse_qsl, urlsplit

from ...core.errors import CaptureError
from ...sensing.packets import PORT
from .paired_boards import find_board, is_board_id

SCHEMES = ("udp", "tcp")
#: What `?key=none` risks.
FORGERY_WARNING = "without a key, anyone on the network can send readings in the board's name"
_FORM = "udp://HOST[:PORT], tcp://HOST[:PORT], or udp://NAME of a paired board"


@dataclass(frozen=True)
class NetworkAddress:
    """Where a board with Wi-Fi is reached.

    Attributes:
        url: The text that the user gave.
        scheme: `udp` or `tcp`.
        host: Name or address of the host.
        port: Port number.
        board_id: Id of the board that must answer, 12 hexadecimal digits; None for any.
        is_authenticated: Whether packets must have the tag of a paired board.
    """

    url: str
    scheme: str
    host: str
    port: int
    board_id: str | None
    is_authenticated: bool

    @property
    def host_and_port(self) -> str:
        """The address as `HOST`, or `HOST:PORT` if the port is not the usual one."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return host if self.port == PORT else f"{host}:{self.port}"


def is_network_url(text: str) -> bool:
    """Return whether a port is that of a board with Wi-Fi."""
    return text.partition("://")[0].lower() in SCHEMES and "://" in text


def is_forgeable(text: str) -> bool:
    """Return whether a port accepts packets that anyone on the network can forge."""
    return is_network_url(text) and ("key", "none") in parse_qsl(text.partition("?")[2])


def parse_network_url(text: str) -> NetworkAddress:
    """Parse the URL of a board with Wi-Fi.

    Args:
        text: `udp://HOST[:PORT][?key=none]`, `tcp://HOST[:PORT][?key=none]`, or the same with the
            id or the name of a paired board instead of the host.

    Raises:
        CaptureError: The URL is not valid (`port-url-invalid`), the paired board is not known
            (`board-not-paired`) or has no known address (`board-address-unknown`), or the file of
            paired boards is not valid.
    """
    try:
        parts = urlsplit(text)
    except ValueError as error:  # an IPv6 address without its bracket
        _refuse(text, f"is not a valid URL ({error})")
    host, port = _host_and_port(text, parts.netloc)
    if parts.path not in ("", "/") or parts.fragment:
        _refuse(text, f"{parts.path or '#' + parts.fragment!r} does not belong after the host")
    options = parse_qsl(parts.query, keep_blank_values=True)
    unknown = [f"{k}={v}" for k, v in options if (k, v) != ("key", "none")]
    if unknown or (parts.query and not options):
        _refuse(text, f"{(unknown or [parts.query])[0]!r} is not an option; only key=none is")
    board = find_board(host)
    if board is None:
        if is_board_id(host.lower()):
            raise not_paired(text, host.lower())
        return NetworkAddress(text, parts.scheme, host, port or PORT, None, not options)
    if not board.address:
        raise CaptureError(
            f"the address of the board {board.name} is not known",
            code="board-address-unknown",
            where=text,
            action=f"Give its address once, as {parts.scheme}://ADDRESS",
            board=board.board_id,
        )
    stored_host, stored_port = _host_and_port(text, board.address)
    return NetworkAddress(
        text, parts.scheme, stored_host, port or stored_port or PORT, board.board_id, not options
    )


def not_paired(url: str, board_id: str) -> CaptureError:
    """Return the error for a board without a stored key."""
    return CaptureError(
        f"the board {board_id} is not paired with this computer",
        code="board-not-paired",
        where=url,
        action="Connect it by USB and pair it (defsense board pair)",
        board=board_id,
    )


def _host_and_port(url: str, netloc: str) -> tuple[str, int | None]:
    """Return the host and the port number of an address."""
    parts = urlsplit(f"//{netloc}")
    try:
        port = parts.port
    except ValueError:
        _refuse(url, f"the port number in {netloc!r} must be from 1 to 65535")
    if not parts.hostname or "@" in netloc:
        _refuse(url, "names no host" if "@" not in netloc else "must not have a user name")
    if netloc.startswith("[") and netloc.partition("]")[2][:1] not in ("", ":"):
        _refuse(url, f"has text behind the brackets in {netloc!r}")
    if port == 0:
        _refuse(url, f"the port number in {netloc!r} must be from 1 to 65535")
    return _hostname(netloc), port


def _hostname(netloc: str) -> str:
    """Return the host of an address with the case that the user wrote, as names have one."""
    if netloc.startswith("["):
        return netloc[1:].partition("]")[0]
    return netloc.partition(":")[0]


def _refuse(url: str, problem: str) -> NoReturn:
    raise CaptureError(problem, code="port-url-invalid", where=url, action=f"Write {_FORM}")
