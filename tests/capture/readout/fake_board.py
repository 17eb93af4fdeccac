"""A board with Wi-Fi for tests, written from `firmware/PROTOCOL.md`, and a network that damages.

It shares no code with `sensing/packets.py`.
"""

import hashlib
import heapq
import hmac
import random
import select
import socket
import struct
import threading
import time
from dataclasses import dataclass, field

from cobs import cobs

from defsense_fab.sensing.serial_frames import Info, Sample, Text, encode

KEY = bytes(range(16))
BOARD_ID = "a4cf12345678"
SESSION_TIMEOUT_S = 3.0


def tag(key, data):
    return hmac.new(key, data, hashlib.sha256).digest()[:16]


def sums_of(counter, channels=3):
    """Return the readings of a sample, by which a test knows genuine ones."""
    return tuple(counter * (2 * n + 7) % 1000 for n in range(channels))


@dataclass
class Network:
    """What happens to the packets from the board to the host, and to those back.

    Attributes:
        loss: Share of the packets that is lost, in each direction.
        reordered: Share of the packets that is delayed by up to `delay` s.
        duplicates: Share of the packets that arrives twice.
    """

    seed: int = 0
    loss: float = 0.0
    reordered: float = 0.0
    duplicates: float = 0.0
    delay: float = 0.015

    def __post_init__(self):
        self._rng = random.Random(self.seed)

    def delays(self):
        """Return the delays, s, of the copies of a packet that arrive."""
        if self._rng.random() < self.loss:
            return []
        first = self._rng.random() * self.delay if self._rng.random() < self.reordered else 0.0
        copies = [first]
        if self._rng.random() < self.duplicates:
            copies.append(first + self._rng.random() * self.delay)
        return copies


@dataclass
class Boot:
    """What a board did from one start to the next.

    Attributes:
        taken: True times of the samples, s of the host's monotonic clock, by counter.
        sent: Times at which they were given to the network, s; only of samples that were sent.
        dropped: Counters of the samples that the network lost.
    """

    boot_id: int
    started_at: float
    taken: dict = field(default_factory=dict)
    sent: dict = field(default_factory=dict)
    dropped: set = field(default_factory=set)


class FakeBoard:
    """A board that listens on a port of this machine in a thread.

    Args:
        scheme: `udp` or `tcp`.
        key: Its pairing key.
        rate: Samples per second.
        drift: Relative error of its clock.
        network: What happens to its packets; over TCP nothing.
        port: Its port; 0 for any.
        seed: Seed of its random numbers, such as the boot id.
    """

    def __init__(
        self,
        scheme="udp",
        key=KEY,
        board_id=BOARD_ID,
        rate=100,
        drift=0.0,
        network=None,
        port=0,
        seed=1,
    ):
        self._key, self._board_id = key, bytes.fromhex(board_id)
        self._rate, self._drift = rate, drift
        self._is_udp, self._network = scheme == "udp", network or Network()
        kind = socket.SOCK_DGRAM if self._is_udp else socket.SOCK_STREAM
        self._socket = socket.socket(socket.AF_INET, kind)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.bind(("127.0.0.1", port))
        if not self._is_udp:
            self._socket.listen()
        self.port = self._socket.getsockname()[1]
        self.url = f"{scheme}://127.0.0.1:{self.port}"
        self._rng = random.Random(seed)
        self._peer, self._buffer, self._delayed, self._count = None, b"", [], 0
        self.boots, self.genuine, self.repeated = [], [], 0
        self.network_is_down = False
        self._silent_until, self.hellos = 0.0, 0
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._boot()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self._stop.set()
        self._thread.join(120)
        self._hang_up()
        self._socket.close()

    def reboot(self, seconds=0.5):
        """Restart: be off for a time, then start with a new boot id and without a session."""
        with self._lock:
            self._silent_until = time.monotonic() + seconds
            self._hang_up()
            self._boot()

    def pause(self):
        """Take no more samples, and wait until the network has delivered the last ones."""
        with self._lock:
            self._silent_until = float("inf")
        while self._delayed:
            time.sleep(0.01)

    def send_raw(self, packet):
        """Send a packet to the host that may be forged."""
        with self._lock:
            self._put(packet)

    def send_stream(self, data):
        """Send bytes to the host over TCP that may be no packets."""
        with self._lock:
            self._peer.sendall(data)

    def _boot(self):
        self.boots.append(Boot(self._rng.getrandbits(32), time.monotonic()))
        self._session, self._pending, self._counter = None, {}, 0
        self._last_valid, self._sends = 0.0, False
        self._received, self._sequence = set(), 0
        self._channels, self._averages, self._led = 3, 4, 1000

    def _hang_up(self):
        if not self._is_udp and self._peer is not None:
            self._peer.close()
            self._peer, self._buffer = None, b""

    def _run(self):
        next_sample = time.monotonic()
        while not self._stop.is_set():
            now = time.monotonic()
            due = min([next_sample, *(self._delayed[0][:1] if self._delayed else ())])
            self._listen(max(0.0, min(due - now, 0.01)))
            with self._lock:
                now = time.monotonic()
                while self._delayed and self._delayed[0][0] <= now:
                    self._put(heapq.heappop(self._delayed)[2])
                if now < self._silent_until:
                    next_sample = now + 1 / self._rate
                while next_sample <= now:
                    self._take_sample(next_sample)
                    next_sample += 1 / self._rate

    def _listen(self, timeout):
        listeners = [self._socket]
        if not self._is_udp and self._peer is not None:
            listeners.append(self._peer)
        for ready in select.select(listeners, [], [], timeout)[0]:
            with self._lock:
                if self._is_udp:
                    data, address = self._socket.recvfrom(2048)
                    if time.monotonic() >= self._silent_until:
                        for _ in self._network.delays():
                            self._handle(data, address)
                elif ready is self._socket:
                    self._hang_up()
                    self._peer, _ = self._socket.accept()
                    self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                elif ready is self._peer:
                    self._read_stream()

    def _read_stream(self):
        try:
            data = self._peer.recv(4096)
        except OSError:
            data = b""
        if not data:
            self._hang_up()
            return
        *packets, self._buffer = (self._buffer + data).split(b"\0")
        for packet in packets:
            self._handle(cobs.decode(packet), None)

    def _handle(self, data, address):
        if len(data) < 23 or data[:2] != b"\xd5\x01" or self.network_is_down:
            return
        kind, body = data[2:3], data[3:-16]
        if kind == b"H" and data[-16:] == bytes(16) and len(body) == 32:
            self._answer_hello(body[:8], address)
            return
        for key in (self._session, *self._pending):
            if key is not None and hmac.compare_digest(tag(key, data[:-16]), data[-16:]):
                break
        else:
            return
        if key is not self._session:
            self._session, self._received, self._sequence = key, set(), 0
            self._pending, self._sends = {}, False
        sequence = int.from_bytes(body[:4], "little")
        if sequence in self._received or sequence <= max(self._received, default=0) - 64:
            return
        self._received.add(sequence)
        self._last_valid = time.monotonic()
        if self._is_udp:
            self._peer = address
        if kind == b"P":
            self._send(b"Q", body[4:12] + struct.pack("<I", self._micros(time.monotonic())))
        elif kind == b"W":
            for line in filter(None, body[4:].decode("ascii").split("\n")):
                self._obey(line)

    def _answer_hello(self, nonce, address):
        self.hellos += 1
        boot = struct.pack("<I", self.boots[-1].boot_id)
        board_nonce = self._rng.randbytes(8)
        content = nonce + self._board_id + boot + board_nonce
        key = hmac.new(self._key, b"defsense 1" + content, hashlib.sha256).digest()
        self._pending = {key: True}  # the newest challenge only, as boards have little memory
        packet = b"\xd5\x01C" + content
        packet += tag(self._key, packet)
        if self._is_udp:
            for _ in self._network.delays():
                self._socket.sendto(packet, address)
        else:
            self._put(packet)

    def _obey(self, line):
        word, _, number = line.partition(" ")
        settings = {"rate": "_rate", "channels": "_channels", "average": "_averages", "led": "_led"}
        if word == "frames":
            self._sends = True
        elif word in settings and number.isdecimal():
            setattr(self, settings[word], int(number))
        elif word != "version":
            self._send(b"R", encode(Text(f"unknown command {word}")))
            return
        info = Info(1, (1, 0), 1, self._channels, self._averages, self._rate, self._led, 16, 26400)
        self._send(b"R", b"\0" + encode(info))

    def _micros(self, now):
        return int((now - self.boots[-1].started_at) * (1 + self._drift) * 1e6) % 2**32

    def _take_sample(self, at):
        boot, counter = self.boots[-1], self._counter
        self._counter += 1
        boot.taken[counter] = at
        if not self._sends or time.monotonic() - self._last_valid > SESSION_TIMEOUT_S:
            return
        sample = Sample(
            counter,
            self._micros(at),
            False,
            False,
            self._averages,
            sums_of(counter, self._channels),
        )
        boot.sent[counter] = time.monotonic()
        if not self._send(b"R", encode(sample)):
            boot.dropped.add(counter)

    def _send(self, kind, body):
        """Send a packet of the session; return whether it is to arrive."""
        self._sequence += 1
        data = b"\xd5\x01" + kind + struct.pack("<I", self._sequence) + body
        data += tag(self._session, data)
        self.genuine.append(data)
        delays = self._network.delays() if self._is_udp else [0.0]
        self.repeated += max(len(delays) - 1, 0)
        for delay in delays:
            if delay:
                self._count += 1
                heapq.heappush(self._delayed, (time.monotonic() + delay, self._count, data))
            else:
                self._put(data)
        return bool(delays)

    def _put(self, data):
        if self._peer is None or self.network_is_down:
            return
        try:
            if self._is_udp:
                self._socket.sendto(data, self._peer)
            else:
                self._peer.sendall(cobs.encode(data) + b"\0")
        except OSError:
            self._hang_up()
