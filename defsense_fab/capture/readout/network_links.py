"""Sockets that carry packets to and from a board: UDP datagrams, or a TCP stream."""

from __future__ import annotations

import contextlib
import selectors
import socket
import time
from typing import Protocol

from cobs import cobs

from ...core.errors import CaptureError
from ...sensing.packets import MAX_PACKET_BYTES
from .network_url import NetworkAddress

TCP_TIMEOUT_S = 2.0  # for connecting and for writing
_MAX_BATCH = 64  # packets that are read before the caller has a turn
_RECEIVE_BUFFER_BYTES = 1 << 20  # two seconds of the largest packets at 1000 Hz
_READ_BYTES = 1 << 16
_MAX_ENCODED_BYTES = MAX_PACKET_BYTES + MAX_PACKET_BYTES // 254 + 1


class Link(Protocol):
    """A connection to one address over which whole packets travel.

    Attributes:
        malformed: Number of byte sequences that were no packets; they are not returned.
    """

    malformed: int

    def send(self, packet: bytes) -> None:
        """Send a packet; raise OSError when the connection is gone."""

    def receive(self, timeout: float) -> list[tuple[bytes, int]]:
        """Return packets with their arrival times.

        Args:
            timeout: Longest time to wait for the first packet, s.

        Returns:
            The packets, each with the host's monotonic clock, ns; empty after the timeout.

        Raises:
            OSError: The connection is gone.
        """
        ...

    def close(self) -> None:
        """Close the socket."""


def open_link(address: NetworkAddress) -> Link:
    """Open a socket to a board.

    Raises:
        CaptureError: The host is not known (`host-unknown`), or nothing answers at its address
            (`board-unreachable`).
    """
    kind = socket.SOCK_DGRAM if address.scheme == "udp" else socket.SOCK_STREAM
    try:
        answers = socket.getaddrinfo(address.host, address.port, type=kind)
    except (OSError, UnicodeError):
        raise CaptureError(
            f"the host {address.host!r} is not known in this network, and no paired board has"
            " this name",
            code="host-unknown",
            where=address.url,
            action="Check the spelling, or give the board's address, such as udp://192.168.1.20",
            host=address.host,
        ) from None
    family, _, _, _, target = min(answers, key=lambda a: a[0] != socket.AF_INET)
    link_socket = socket.socket(family, kind)
    try:
        link_socket.settimeout(TCP_TIMEOUT_S)
        link_socket.connect(target)
    except OSError as error:
        link_socket.close()
        raise unreachable(address, str(error.strerror or error)) from None
    return _UdpLink(link_socket) if address.scheme == "udp" else _TcpLink(link_socket)


def unreachable(address: NetworkAddress, reason: str) -> CaptureError:
    """Return the error for an address at which no board answers."""
    return CaptureError(
        f"no board answers at {address.host}, {address.scheme.upper()} port {address.port}"
        f" ({reason})",
        code="board-unreachable",
        where=address.url,
        action=(
            "Check that the board is on, paired and in the same network, that its address is still"
            " this one, and that no firewall blocks the port"
        ),
        host=address.host,
        port=address.port,
    )


class _Socket:
    """A connected socket and its selector."""

    def __init__(self, connected: socket.socket) -> None:
        self.malformed = 0
        self._socket, self._selector = connected, selectors.DefaultSelector()
        self._selector.register(connected, selectors.EVENT_READ)

    def _wait(self, timeout: float) -> bool:
        """Return whether data arrived within a time, s."""
        return bool(self._selector.select(max(timeout, 0.0)))

    def close(self) -> None:
        self._selector.close()
        self._socket.close()


class _UdpLink(_Socket):
    """Packets in datagrams, each of which may be lost, repeated or overtaken.

    Reports that nothing listens at the other end are ignored, because anyone can forge them.
    """

    def __init__(self, connected: socket.socket) -> None:
        super().__init__(connected)
        connected.setblocking(False)
        with contextlib.suppress(OSError):
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)

    def send(self, packet: bytes) -> None:
        with contextlib.suppress(ConnectionError, BlockingIOError):
            self._socket.send(packet)

    def receive(self, timeout: float) -> list[tuple[bytes, int]]:
        packets: list[tuple[bytes, int]] = []
        if not self._wait(timeout):
            return packets
        while len(packets) < _MAX_BATCH:
            try:
                packet = self._socket.recv(_READ_BYTES)  # Windows refuses to cut longer ones
            except BlockingIOError:
                break
            except ConnectionError:
                continue
            packets.append((packet, time.monotonic_ns()))
        return packets


class _TcpLink(_Socket):
    """Packets in a stream: each is encoded with COBS and ends with a zero byte."""

    def __init__(self, connected: socket.socket) -> None:
        super().__init__(connected)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._rest = b""
        self._is_skipping = False  # the rest of a sequence that is too long

    def send(self, packet: bytes) -> None:
        self._socket.sendall(cobs.encode(packet) + b"\0")

    def receive(self, timeout: float) -> list[tuple[bytes, int]]:
        if not self._wait(timeout):
            return []
        data = self._socket.recv(_READ_BYTES)
        if not data:
            raise ConnectionResetError("the board closed the connection")
        now = time.monotonic_ns()
        *frames, self._rest = (self._rest + data).split(b"\0")
        packets = []
        for frame in frames:
            packet = None if self._is_skipping else _decode_frame(frame)
            if packet:
                packets.append((packet, now))
            elif frame and not self._is_skipping:
                self.malformed += 1
            self._is_skipping = False
        if len(self._rest) > _MAX_ENCODED_BYTES:
            self.malformed += not self._is_skipping
            self._rest, self._is_skipping = b"", True
        return packets


def _decode_frame(frame: bytes) -> bytes | None:
    """Return the packet of a frame without its zero byte; None if it is malformed."""
    if len(frame) > _MAX_ENCODED_BYTES:
        return None
    try:
        return bytes(cobs.decode(frame))
    except cobs.DecodeError:
        return None
