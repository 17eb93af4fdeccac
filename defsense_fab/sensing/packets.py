"""Packets between hosts and boards with Wi-Fi, encoded and decoded; see `firmware/PROTOCOL.md`.

A packet is a version, a kind, a body and a tag. The tag is a truncated HMAC-SHA256 (RFC 2104), by
which the receiver knows that the packet was written by a holder of the key and was not changed.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from dataclasses import dataclass
from enum import IntEnum

PORT = 20160
MAX_PACKET_BYTES = 512
PAIRING_KEY_BYTES = 16
NONCE_BYTES = 8
BOARD_ID_BYTES = 6
#: Pairing key of boards that accept packets that anyone can forge.
OPEN_KEY = bytes(PAIRING_KEY_BYTES)
#: Largest number of packets by which one that was not seen yet may be behind the newest one.
REPLAY_WINDOW = 64

_MAGIC, _VERSION = 0xD5, 1
_HEAD = struct.Struct("<BBB")
_TAG_BYTES = 16
_HELLO = struct.Struct("<8s24x")
_CHALLENGE = struct.Struct("<8s6sI8s")
_SEQUENCE = struct.Struct("<I")
_PONG_DATA = struct.Struct("<8sI")
_PING_DATA_BYTES = 8
_SESSION_LABEL = b"defsense 1"
#: Largest number of bytes of the serial protocol in a packet.
MAX_DATA_BYTES = MAX_PACKET_BYTES - _HEAD.size - _SEQUENCE.size - _TAG_BYTES


class Kind(IntEnum):
    """Kinds of packets."""

    HELLO = ord("H")
    CHALLENGE = ord("C")
    WRITE = ord("W")
    READ = ord("R")
    PING = ord("P")
    PONG = ord("Q")


_KINDS = frozenset(Kind)


@dataclass(frozen=True)
class Challenge:
    """Answer of a board to a hello.

    Attributes:
        host_nonce: Random bytes of the hello (8 bytes).
        board_id: Identity of the board (6 bytes).
        boot_id: Random number that the board chose when it started.
        board_nonce: Random bytes of the board (8 bytes).
    """

    host_nonce: bytes
    board_id: bytes
    boot_id: int
    board_nonce: bytes

    def session_key(self, pairing_key: bytes) -> bytes:
        """Return the key of the session that this challenge starts (32 bytes)."""
        body = _CHALLENGE.pack(self.host_nonce, self.board_id, self.boot_id, self.board_nonce)
        return hmac.new(pairing_key, _SESSION_LABEL + body, hashlib.sha256).digest()


@dataclass(frozen=True)
class Packet:
    """A packet of a session.

    Attributes:
        kind: WRITE, READ, PING or PONG.
        sequence: Number of the packet in its direction, from 1.
        data: What follows the sequence in the body.
    """

    kind: Kind
    sequence: int
    data: bytes


def encode_hello(host_nonce: bytes) -> bytes:
    """Return the packet by which a host asks for a challenge."""
    return _HEAD.pack(_MAGIC, _VERSION, Kind.HELLO) + _HELLO.pack(host_nonce) + bytes(_TAG_BYTES)


def decode_hello(packet: bytes) -> bytes | None:
    """Return the host's nonce from a hello; None if the packet is not a valid hello."""
    if _kind(packet) is not Kind.HELLO or len(packet) != _HEAD.size + _HELLO.size + _TAG_BYTES:
        return None
    (nonce,) = _HELLO.unpack(packet[_HEAD.size : -_TAG_BYTES])
    return nonce if packet == encode_hello(nonce) else None


def encode_challenge(challenge: Challenge, pairing_key: bytes) -> bytes:
    """Return the packet of a challenge."""
    c = challenge
    body = _CHALLENGE.pack(c.host_nonce, c.board_id, c.boot_id, c.board_nonce)
    return _seal(Kind.CHALLENGE, body, pairing_key)


def read_challenge(packet: bytes) -> Challenge | None:
    """Return the content of a challenge without checking its tag; None if it is malformed.

    The board id names the key by which `has_valid_tag` checks the packet.
    """
    size = _HEAD.size + _CHALLENGE.size + _TAG_BYTES
    if _kind(packet) is not Kind.CHALLENGE or len(packet) != size:
        return None
    return Challenge(*_CHALLENGE.unpack(packet[_HEAD.size : -_TAG_BYTES]))


def has_valid_tag(packet: bytes, key: bytes) -> bool:
    """Return whether the tag of a packet was made with a key."""
    return hmac.compare_digest(_tag(packet[:-_TAG_BYTES], key), packet[-_TAG_BYTES:])


def encode_packet(packet: Packet, session_key: bytes) -> bytes:
    """Return the bytes of a packet of a session.

    Raises:
        ValueError: If the packet would be longer than MAX_PACKET_BYTES.
    """
    if len(packet.data) > MAX_DATA_BYTES:
        raise ValueError(f"a packet holds {MAX_DATA_BYTES} bytes, not {len(packet.data)}")
    return _seal(packet.kind, _SEQUENCE.pack(packet.sequence) + packet.data, session_key)


def decode_packet(data: bytes, session_key: bytes) -> Packet | None:
    """Decode a packet of a session.

    Args:
        data: All bytes of the packet.
        session_key: Key of the session (32 bytes).

    Returns:
        The packet; None if it is malformed, or if its tag is not of this session.
    """
    kind = _kind(data)
    if kind is None or kind in (Kind.HELLO, Kind.CHALLENGE):
        return None
    if not has_valid_tag(data, session_key):
        return None
    body = data[_HEAD.size : -_TAG_BYTES]
    sequence, rest = int.from_bytes(body[: _SEQUENCE.size], "little"), body[_SEQUENCE.size :]
    lengths = {Kind.PING: _PING_DATA_BYTES, Kind.PONG: _PONG_DATA.size}
    if sequence == 0 or len(rest) != lengths.get(kind, len(rest)):
        return None
    return Packet(kind, sequence, rest)


def pong_content(packet: Packet) -> tuple[bytes, int]:
    """Return the bytes of the ping that a pong answers, and the board's clock, us."""
    data, micros = _PONG_DATA.unpack(packet.data)
    return data, micros


class ReplayWindow:
    """Sequences of one direction of a session that were received (RFC 4303, section 3.4.3).

    Attributes:
        highest: Highest sequence so far; 0 before the first packet.
    """

    def __init__(self) -> None:
        self.highest = 0
        self._seen = 0  # bit k: the packet k behind the highest was received

    def has_expired(self, sequence: int) -> bool:
        """Return whether a sequence is too far behind the highest to be known."""
        return sequence <= self.highest - REPLAY_WINDOW

    def accept(self, sequence: int) -> bool:
        """Record a sequence.

        Returns:
            False if the sequence was received before, or has expired.
        """
        ahead = sequence - self.highest
        if ahead > 0:
            self._seen = (self._seen << ahead | 1) if ahead < REPLAY_WINDOW else 1
            self._seen &= (1 << REPLAY_WINDOW) - 1
            self.highest = sequence
            return True
        if self.has_expired(sequence) or self._seen >> -ahead & 1:
            return False
        self._seen |= 1 << -ahead
        return True


def _kind(packet: bytes) -> Kind | None:
    """Return the kind of a packet; None if its head or its length is not valid."""
    if not _HEAD.size + _SEQUENCE.size + _TAG_BYTES <= len(packet) <= MAX_PACKET_BYTES:
        return None
    magic, version, kind = _HEAD.unpack_from(packet)
    is_known = (magic, version) == (_MAGIC, _VERSION) and kind in _KINDS
    return Kind(kind) if is_known else None


def _seal(kind: Kind, body: bytes, key: bytes) -> bytes:
    packet = _HEAD.pack(_MAGIC, _VERSION, kind) + body
    return packet + _tag(packet, key)


def _tag(data: bytes, key: bytes) -> bytes:
    return hmac.new(key, data, hashlib.sha256).digest()[:_TAG_BYTES]
