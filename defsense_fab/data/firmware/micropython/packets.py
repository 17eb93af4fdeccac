"""Packets between hosts and a board with Wi-Fi: tags, challenges and sequences."""

import hashlib
import struct

PORT = 20160
MAX_PACKET = 512
KEY_SIZE = 16
NONCE_SIZE = 8
TAG_SIZE = 16
#: Pairing key of boards that accept packets that anyone can forge.
OPEN_KEY = bytes(KEY_SIZE)
HELLO, CHALLENGE, WRITE, READ, PING, PONG = b"HCWRPQ"

_MAGIC, _VERSION = 0xD5, 1
_HEAD = 3
_SEQUENCE_SIZE = 4
_HELLO_PADDING = bytes(24 + TAG_SIZE)
_HELLO_SIZE = _HEAD + NONCE_SIZE + len(_HELLO_PADDING)
_LABEL = b"defsense 1"
_PING_SIZE = 8
_WINDOW = 64
_BLOCK = 64  # bytes of a block of SHA-256
#: Largest number of bytes of the serial protocol in a packet.
MAX_DATA = MAX_PACKET - _HEAD - _SEQUENCE_SIZE - TAG_SIZE


class Key:
    """A key of HMAC-SHA256 (RFC 2104), with its padded blocks ready.

    Args:
        key: The key, at most 64 bytes.
    """

    def __init__(self, key):
        padded = key + bytes(_BLOCK - len(key))
        self._inner = bytes([byte ^ 0x36 for byte in padded])
        self._outer = bytes([byte ^ 0x5C for byte in padded])

    def compute_hmac(self, *parts):
        """Return the HMAC-SHA256 of the parts in a row (32 bytes)."""
        inner = hashlib.sha256(self._inner)
        for part in parts:
            inner.update(part)
        outer = hashlib.sha256(self._outer)
        outer.update(inner.digest())
        return outer.digest()

    def is_valid(self, packet):
        """Return whether the tag of a packet was made with this key, in constant time."""
        expected = self.compute_hmac(packet[:-TAG_SIZE])
        difference = 0
        for i in range(TAG_SIZE):
            difference |= expected[i] ^ packet[i - TAG_SIZE]
        return difference == 0


def read_hello(packet):
    """Return the host's nonce from a hello; None if the packet is not a valid hello."""
    if len(packet) != _HELLO_SIZE or _kind(packet) != HELLO:
        return None
    if packet[_HEAD + NONCE_SIZE :] != _HELLO_PADDING:
        return None
    return packet[_HEAD : _HEAD + NONCE_SIZE]


class Handshake:
    """The challenge that answers a hello, and the session that it starts.

    Args:
        pairing_key: Key of the board, `Key`.
        host_nonce: Random bytes of the hello (8 bytes).
        board_id: Identity of the board (6 bytes).
        boot_id: Random number of this start of the board, little-endian (4 bytes).
        board_nonce: Random bytes of the board (8 bytes).

    Attributes:
        host_nonce: Random bytes of the hello.
        challenge: The packet of the challenge.
        session_key: Key of the session, `Key`.
    """

    def __init__(self, pairing_key, host_nonce, board_id, boot_id, board_nonce):
        body = host_nonce + board_id + boot_id + board_nonce
        packet = bytes([_MAGIC, _VERSION, CHALLENGE]) + body
        self.host_nonce = host_nonce
        self.challenge = packet + pairing_key.compute_hmac(packet)[:TAG_SIZE]
        self.session_key = Key(pairing_key.compute_hmac(_LABEL, body))


def encode_packet(kind, sequence, data, session_key):
    """Return the bytes of a packet of a session.

    Args:
        kind: WRITE, READ, PING or PONG.
        sequence: Number of the packet in its direction, from 1.
        data: What follows the sequence, at most MAX_DATA bytes.
        session_key: Key of the session, `Key`.
    """
    packet = struct.pack("<BBBI", _MAGIC, _VERSION, kind, sequence) + data
    return packet + session_key.compute_hmac(packet)[:TAG_SIZE]


def decode_packet(packet, session_key):
    """Return kind, sequence and data of a packet of a session; None if it must be refused."""
    kind = _kind(packet)
    if kind not in (WRITE, READ, PING, PONG) or not session_key.is_valid(packet):
        return None
    sequence = struct.unpack_from("<I", packet, _HEAD)[0]
    data = packet[_HEAD + _SEQUENCE_SIZE : -TAG_SIZE]
    if sequence == 0:
        return None
    if (kind == PING and len(data) != _PING_SIZE) or (kind == PONG and len(data) != _PING_SIZE + 4):
        return None
    return kind, sequence, data


def _kind(packet):
    """Return the kind of a packet; None if its head or its length is not valid."""
    if not _HEAD + _SEQUENCE_SIZE + TAG_SIZE <= len(packet) <= MAX_PACKET:
        return None
    return packet[2] if packet[0] == _MAGIC and packet[1] == _VERSION else None


class ReplayWindow:
    """Sequences that were received in a session (RFC 4303, section 3.4.3)."""

    def __init__(self):
        self._highest = 0
        self._seen = 0  # bit k: the packet k behind the highest was received

    def accept(self, sequence):
        """Record a sequence; return False if it was received before or is too old."""
        ahead = sequence - self._highest
        if ahead > 0:
            self._seen = (self._seen << ahead | 1) if ahead < _WINDOW else 1
            self._seen &= (1 << _WINDOW) - 1
            self._highest = sequence
            return True
        if -ahead >= _WINDOW or self._seen >> -ahead & 1:
            return False
        self._seen |= 1 << -ahead
        return True
