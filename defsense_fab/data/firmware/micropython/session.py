"""The link over Wi-Fi: one session with one host at a time."""

from frames import MAX_FRAME
from links import MAX_LINE, LineReader
from packets import (
    MAX_DATA,
    NONCE_SIZE,
    PING,
    PONG,
    READ,
    WRITE,
    Handshake,
    ReplayWindow,
    decode_packet,
    encode_packet,
    read_hello,
)

TIMEOUT_MS = 3000  # without a valid packet
#: Frames of faster samples share packets, for at most this time.
MAX_DELAY_US = 10000
_MAX_HANDSHAKES = 4  # that wait for a packet of their session
_MAX_INPUT = 1024  # bytes of commands
_MAX_SEQUENCE = 0xFFFFFFFF


class NetworkLink:
    """Answers hellos, checks packets, and carries the bytes of the serial protocol.

    Args:
        clock: The board's clock.
        board_id: Identity of the board (6 bytes).
        random_bytes: Function that returns so many random bytes, such as `os.urandom`.

    Attributes:
        is_local: False: Wi-Fi cannot be set up here.
        line: The command that is being received.
        peer: Where the session's packets go, an object with `send(packet)`, `has_room()` and
            `is_open`; None without a session.
        key: Pairing key, `Key`; None if the board answers no packets.
        sockets: Object with the method `poll`, which calls `receive`; None while there is none.
    """

    is_local = False

    def __init__(self, clock, board_id, random_bytes):
        self.line = LineReader(MAX_LINE)
        self.peer = self.key = self.sockets = None
        self._clock, self._board_id, self._random_bytes = clock, board_id, random_bytes
        self._boot_id = random_bytes(4)
        self._handshakes = []
        self._output = bytearray(MAX_DATA)
        self._view = memoryview(self._output)
        self.end()

    def set_key(self, key):
        """Set the pairing key, or None, and end the session."""
        self.key = key
        self._handshakes = []
        self.end()

    def end(self):
        """End the session."""
        self.peer = None
        self._session = None
        self._start()

    @property
    def is_framed(self):
        """Whether samples are sent: after the command `frames`, while the host is there."""
        return self._has_frames and self._is_active

    def receive(self, packet, peer):
        """Handle a packet that arrived.

        Args:
            packet: All bytes of the packet.
            peer: Where answers go.
        """
        if self.key is None:
            return
        nonce = read_hello(packet)
        if nonce is not None:
            peer.send(self._find_handshake(nonce).challenge)
            return
        if self._session is not None:
            content = decode_packet(packet, self._session.session_key)
            if content is not None:
                self._accept(content, peer)
                return
        for handshake in self._handshakes:
            content = decode_packet(packet, handshake.session_key)
            if content is not None and content[0] in (WRITE, PING):
                self._session = handshake
                self._handshakes = []
                self._start()
                self._accept(content, peer)
                return

    def poll(self):
        """Receive packets, send frames that have waited, and notice that the host is gone."""
        if self.sockets is not None:
            self.sockets.poll()
        clock = self._clock
        if self._is_active and (
            clock.ticks_diff(clock.ticks_ms(), self._heard_at) > TIMEOUT_MS or not self.peer.is_open
        ):
            self._is_active = False
            self._length = 0
        if self._length and clock.ticks_diff(clock.ticks_us(), self._first_at) >= MAX_DELAY_US:
            self._flush()
        while self._input and not self.line.is_complete:
            self.line.add(self._input[0])
            self._input = self._input[1:]

    def has_room_for_answer(self):
        """Return whether an answer is sure to fit."""
        return self.peer is None or self.peer.has_room()

    def send_answer(self, frame, length):
        """Send the frame of an answer at once."""
        self._add(frame, length)
        self._flush()

    def send_sample(self, frame, length, period):
        """Send the frame of a sample; frames of fast samples share a packet.

        Args:
            frame: Buffer with the frame.
            length: Length of the frame.
            period: Time between samples, us.
        """
        self._add(frame, length)
        if period >= MAX_DELAY_US or self._length + MAX_FRAME > MAX_DATA:
            self._flush()

    def start_frames(self):
        """Send frames of samples from now on."""
        self._has_frames = True

    def start_plain(self):
        """Send no more samples: plain lines are never sent in packets."""
        self._has_frames = False

    def _find_handshake(self, nonce):
        """Return the handshake with a host's nonce.

        Hellos of one attempt get the same challenge. The nonce of the running session makes no
        second session with its key, in which packets could be replayed.
        """
        if self._session is not None and self._session.host_nonce == nonce:
            return self._session
        for handshake in self._handshakes:
            if handshake.host_nonce == nonce:
                return handshake
        handshake = Handshake(
            self.key, nonce, self._board_id, self._boot_id, self._random_bytes(NONCE_SIZE)
        )
        self._handshakes = self._handshakes[1 - _MAX_HANDSHAKES :] + [handshake]
        return handshake

    def _start(self):
        """Start counting packets, without frames and commands."""
        self._window = ReplayWindow()
        self._sent = 0
        self._has_frames = self._is_active = False
        self._input = b""
        self._length, self._first_at = 0, 0
        self._heard_at = 0
        self.line.clear()

    def _accept(self, content, peer):
        """Handle a packet with a valid tag of this session."""
        kind, sequence, data = content
        if kind not in (WRITE, PING) or not self._window.accept(sequence):
            return
        self.peer = peer
        self._is_active = True
        self._heard_at = self._clock.ticks_ms()
        if kind == PING:
            micros = self._clock.read_micros()
            self._send(PONG, data + micros.to_bytes(4, "little"))
        elif len(self._input) + len(data) <= _MAX_INPUT:
            self._input += data

    def _add(self, frame, length):
        if self._length + length > MAX_DATA:
            self._flush()
        if not self._length:
            self._first_at = self._clock.ticks_us()
        self._output[self._length : self._length + length] = memoryview(frame)[:length]
        self._length += length

    def _flush(self):
        if self._is_active and self._length:
            self._send(READ, bytes(self._view[: self._length]))
        self._length = 0

    def _send(self, kind, data):
        """Send a packet, or leave it out if there is no room for it."""
        if self._sent == _MAX_SEQUENCE:
            self.end()
        elif self.peer.has_room():
            self._sent += 1
            self.peer.send(encode_packet(kind, self._sent, data, self._session.session_key))
