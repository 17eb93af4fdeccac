"""Exchange packets with a board over Wi-Fi, as a byte stream for the reader."""

from __future__ import annotations

import contextlib
import secrets
import threading
import time
from collections import deque
from dataclasses import dataclass, field, replace

from ...core.errors import CaptureError, DefsenseError
from ...sensing.packets import (
    MAX_DATA_BYTES,
    NONCE_BYTES,
    OPEN_KEY,
    Challenge,
    Kind,
    Packet,
    ReplayWindow,
    decode_packet,
    encode_hello,
    encode_packet,
    has_valid_tag,
    pong_content,
    read_challenge,
)
from .network_links import open_link, unreachable
from .network_url import NetworkAddress, not_paired
from .paired_boards import find_board, store_board
from .source import NetworkStatistics

CONNECT_TIMEOUT_S = 3.0
HELLO_INTERVAL_S = 0.25
CONFIRMATION_TIMEOUT_S = 0.5  # from a challenge to the pong that confirms its session
PING_INTERVAL_S = 1.0
#: Longest time for which a packet waits for those before it.
REORDER_DELAY_S = 0.02
_READ_TIMEOUT_S = 0.05
_MAX_ROUND_TRIPS = 600  # ten minutes of pings


@dataclass(frozen=True)
class BoardIdentity:
    """The board at the other end of a connection.

    Attributes:
        board_id: The board's id, 12 hexadecimal digits.
        boot_id: Random number that the board chose when it started.
        address: The board's address, `HOST:PORT`.
    """

    board_id: str
    boot_id: int
    address: str


@dataclass
class NetworkCounts:
    """Counts of the packets of one or several connections.

    Attributes:
        reordered: Packets that arrived behind a later one, and were put back into order.
        duplicates: Packets that arrived again.
        late: Packets that arrived too late to be put back into order, and were dropped.
        rejected: Packets with a wrong tag, of another session, malformed, or replayed.
        round_trips: Times from a ping to its pong, s; the newest ones.
    """

    reordered: int = 0
    duplicates: int = 0
    late: int = 0
    rejected: int = 0
    round_trips: deque[float] = field(default_factory=lambda: deque(maxlen=_MAX_ROUND_TRIPS))

    def copy(self) -> NetworkCounts:
        """Return the counts as they are now."""
        return replace(self, round_trips=self.round_trips.copy())

    def add(self, other: NetworkCounts) -> None:
        """Add the counts of a later connection."""
        self.reordered += other.reordered
        self.duplicates += other.duplicates
        self.late += other.late
        self.rejected += other.rejected
        self.round_trips.extend(other.round_trips)

    @property
    def statistics(self) -> NetworkStatistics:
        """The counts at this moment."""
        return NetworkStatistics(
            self.reordered, self.duplicates, self.late, self.rejected, tuple(self.round_trips)
        )


class ReorderBuffer:
    """Puts the packets of a session into order; a packet waits for missing ones for a short time.

    Args:
        delay: Longest time for which a packet waits, s.
    """

    def __init__(self, delay: float) -> None:
        self._delay_ns = round(1e9 * delay)
        self._waiting: dict[int, tuple[bytes, int]] = {}
        self._next = 1  # sequence
        self._released_ns = 0  # latest arrival time that was released

    def add(self, sequence: int, data: bytes, arrived_ns: int) -> bool:
        """Add a packet; return False, and drop it, if later ones were released already."""
        if sequence < self._next:
            return False
        self._waiting[sequence] = data, arrived_ns
        return True

    def time_left(self) -> float:
        """Return the time, s, until a packet need not wait any longer; infinity if none does."""
        if not self._waiting:
            return float("inf")
        return (self._oldest_ns() + self._delay_ns - time.monotonic_ns()) / 1e9

    def release(self) -> list[tuple[bytes, int]]:
        """Return the packets that wait no longer, in order, with their arrival times, ns.

        A packet that was waiting for an earlier one has the arrival time of that one, because
        recordings whose times go back are those of several runs.
        """
        released: list[tuple[bytes, int]] = []
        now = time.monotonic_ns()
        while self._waiting:
            first = min(self._waiting)
            if first != self._next and now - self._oldest_ns() < self._delay_ns:
                break
            data, arrived_ns = self._waiting.pop(first)
            self._next, self._released_ns = first + 1, max(arrived_ns, self._released_ns)
            if data:
                released.append((data, self._released_ns))
        return released

    def _oldest_ns(self) -> int:
        return min(arrived_ns for _, arrived_ns in self._waiting.values())


class NetworkPort:
    """A `Transport` to a board with Wi-Fi.

    One thread reads; any thread may write.

    Args:
        address: Where the board is reached.

    Attributes:
        board: The board at the other end.
        counts: Counts of the packets of this connection.

    Raises:
        CaptureError: The host is not known (`host-unknown`), no board answers
            (`board-unreachable`), or the board is not paired (`board-not-paired`), has another
            key (`pairing-key-differs`), or is another one than requested (`board-differs`).
    """

    def __init__(self, address: NetworkAddress) -> None:
        self._address, self.counts = address, NetworkCounts()
        self._rest, self._write_lock, self._sent = b"", threading.Lock(), 0
        self._order, self._window = ReorderBuffer(REORDER_DELAY_S), ReplayWindow()
        self._session_key, self._is_confirmed, self._pinged_at = b"", False, 0.0
        self._nonces: set[bytes] = set()
        self._challenge: Challenge | None = None
        self._problem: CaptureError | None = None  # with challenges of this connection
        self._link = open_link(address)
        try:
            self._connect()
        except OSError as error:
            self._link.close()
            raise unreachable(address, str(error.strerror or error)) from None
        except BaseException:
            self._link.close()
            raise
        assert self._challenge is not None
        board_id, boot_id = self._challenge.board_id.hex(), self._challenge.boot_id
        self.board: BoardIdentity = BoardIdentity(board_id, boot_id, address.host_and_port)
        self._store_address()

    def read_stamped(self) -> list[tuple[bytes, int]]:
        """Return bytes of the serial protocol, each with the arrival time of its packet.

        Returns:
            Whole frames in the order in which they were sent, each with the host's monotonic
            clock when the packet arrived, ns; empty after a short time without any.

        Raises:
            OSError: The connection is gone.
        """
        now = time.monotonic()
        if now - self._pinged_at >= PING_INTERVAL_S:
            self._ping()
        timeout = min(
            _READ_TIMEOUT_S, self._pinged_at + PING_INTERVAL_S - now, self._order.time_left()
        )
        for packet, arrived_ns in self._link.receive(timeout):
            self._receive(packet, arrived_ns)
        self._count_malformed()
        return self._order.release()

    def read(self, size: int) -> bytes:
        """Return at most `size` bytes of the serial protocol.

        Raises:
            OSError: The connection is gone.
        """
        if not self._rest:
            self._rest = b"".join(data for data, _ in self.read_stamped())
        data, self._rest = self._rest[:size], self._rest[size:]
        return data

    @property
    def in_waiting(self) -> int:
        """Number of bytes that `read` returns without waiting."""
        return len(self._rest)

    def write(self, data: bytes) -> int:
        """Send bytes of the serial protocol.

        Raises:
            OSError: The connection is gone.
        """
        for start in range(0, len(data), MAX_DATA_BYTES):
            self._send(Kind.WRITE, data[start : start + MAX_DATA_BYTES])
        return len(data)

    def close(self) -> None:
        """Close the socket; the board stops sending after three seconds without a ping."""
        self._link.close()

    def _connect(self) -> None:
        """Start a session with the board, and have it confirmed."""
        end = time.monotonic() + CONNECT_TIMEOUT_S
        while time.monotonic() < end:
            if self._attempt(end):
                return
        reason = f"no answer within {CONNECT_TIMEOUT_S:g} s"
        raise self._problem or unreachable(self._address, reason)

    def _attempt(self, end: float) -> bool:
        """Send hellos until a challenge arrives, then pings until a pong confirms its session.

        Args:
            end: The host's monotonic clock at which no further attempt is made, s.

        Returns:
            Whether the session is confirmed. Boards may have answered a later hello than the one
            whose challenge arrived; then no pong arrives.
        """
        nonce = secrets.token_bytes(NONCE_BYTES)
        self._nonces.add(nonce)
        self._challenge, next_send = None, 0.0
        while (now := time.monotonic()) < end:
            if now >= next_send:
                next_send = now + HELLO_INTERVAL_S
                if self._challenge is None:
                    self._link.send(encode_hello(nonce))
                else:
                    self._ping()
            for packet, arrived_ns in self._link.receive(next_send - now):
                challenge = read_challenge(packet)
                if challenge is None or challenge.host_nonce != nonce:
                    self._receive(packet, arrived_ns)
                elif self._is_confirmed or challenge == self._challenge:
                    continue  # a replay must not end the session
                elif self._answer(packet, challenge):
                    next_send, end = 0.0, min(end, time.monotonic() + CONFIRMATION_TIMEOUT_S)
            if self._is_confirmed:
                self._count_malformed()
                return True
        return False

    def _answer(self, packet: bytes, challenge: Challenge) -> bool:
        """Start the session of a challenge; return whether its tag is valid."""
        try:
            key = _pairing_key(self._address, packet, challenge)
        except CaptureError as error:  # it may be forged, and a valid one follow
            self._problem = error
            self.counts.rejected += 1
            return False
        self._challenge, self._session_key = challenge, challenge.session_key(key)
        self._order, self._window = ReorderBuffer(REORDER_DELAY_S), ReplayWindow()
        self._sent = 0
        return True

    def _receive(self, data: bytes, arrived_ns: int) -> None:
        """Check a packet and put it into the order of the frames."""
        packet = decode_packet(data, self._session_key) if self._session_key else None
        if packet is None or packet.kind not in (Kind.READ, Kind.PONG):
            self.counts.rejected += not self._is_own_challenge(data)
            return
        if self._window.has_expired(packet.sequence):
            self.counts.rejected += 1
            return
        is_behind = packet.sequence < self._window.highest
        if not self._window.accept(packet.sequence):
            self.counts.duplicates += 1
            return
        if packet.kind is Kind.PONG:
            self._is_confirmed = True
            sent_ns = int.from_bytes(pong_content(packet)[0], "little")
            self.counts.round_trips.append((arrived_ns - sent_ns) / 1e9)
        frames = packet.data if packet.kind is Kind.READ else b""
        if not self._order.add(packet.sequence, frames, arrived_ns):
            self.counts.late += 1
        elif is_behind:
            self.counts.reordered += 1

    def _is_own_challenge(self, data: bytes) -> bool:
        """Return whether a packet repeats the board's answer to a hello of this connection."""
        challenge = read_challenge(data)
        return challenge is not None and challenge.host_nonce in self._nonces

    def _count_malformed(self) -> None:
        self.counts.rejected += self._link.malformed
        self._link.malformed = 0

    def _ping(self) -> None:
        self._pinged_at = time.monotonic()
        self._send(Kind.PING, time.monotonic_ns().to_bytes(8, "little"))

    def _send(self, kind: Kind, data: bytes) -> None:
        with self._write_lock:
            self._sent += 1
            self._link.send(encode_packet(Packet(kind, self._sent, data), self._session_key))

    def _store_address(self) -> None:
        """Store the address of a paired board that was reached by another one than before."""
        if self._address.board_id is not None or not self._address.is_authenticated:
            return
        with contextlib.suppress(DefsenseError):  # the board can be read all the same
            board, address = find_board(self.board.board_id), self._address.host_and_port
            if board is not None and board.address != address:
                store_board(board.board_id, board.name, board.key, address)


def _pairing_key(address: NetworkAddress, packet: bytes, challenge: Challenge) -> bytes:
    """Return the pairing key of the board that sent a challenge.

    Raises:
        CaptureError: The board is another one than requested, is not paired, or has another key.
    """
    board_id = challenge.board_id.hex()
    if address.board_id not in (None, board_id):
        raise board_differs(address.url, str(address.board_id), board_id)
    key = OPEN_KEY
    if address.is_authenticated:
        board = find_board(board_id)
        if board is None:
            raise not_paired(address.url, board_id)
        key = board.key
    if has_valid_tag(packet, key):
        return key
    problem = f"the board {board_id} has another key than this computer"
    action = "Connect it by USB and pair it again (defsense board pair)"
    if not address.is_authenticated:
        problem = f"the board {board_id} has a key"
        action = "Remove ?key=none from the URL"
    raise CaptureError(
        problem, code="pairing-key-differs", where=address.url, action=action, board=board_id
    )


def board_differs(url: str, expected: str, board_id: str) -> CaptureError:
    """Return the error for packets of another device than the expected one."""
    return CaptureError(
        f"packets of another device: the board {board_id} answers, not {expected}",
        code="board-differs",
        where=url,
        action="Check the address, or give the URL of the board that you want to read",
        board=board_id,
        expected=expected,
    )
