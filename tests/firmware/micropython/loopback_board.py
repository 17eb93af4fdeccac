"""The program under CPython: sockets of this machine, a pseudo-terminal, a simulated radio.

python loopback_board.py PROGRAM SETTINGS.json PORT

It prints one line of JSON: the serial port and the UDP and TCP ports. A network named `missing` is
not found, `slow` is never joined, and the password `wrong-password` is wrong.
"""

import json
import os
import select
import socket
import sys
import time
import tty

program, settings_file, port = sys.argv[1:]
sys.path.insert(0, program)

from board import Board, Clock  # noqa: E402
from internal_adc import InternalAdc  # noqa: E402
from links import SerialLink  # noqa: E402
from session import NetworkLink  # noqa: E402
from sockets import Sockets  # noqa: E402
from wifi import JsonFile, Wifi  # noqa: E402

BOARD_ID = bytes.fromhex("a4cf12345678")
TICKS = 1 << 30


class Time:
    """`time` of MicroPython."""

    @staticmethod
    def ticks_us():
        return time.monotonic_ns() // 1000 % TICKS

    @staticmethod
    def ticks_ms():
        return time.monotonic_ns() // 1_000_000 % TICKS

    @staticmethod
    def ticks_add(ticks, delta):
        return (ticks + delta) % TICKS

    @staticmethod
    def ticks_diff(end, start):
        return (end - start + TICKS // 2) % TICKS - TICKS // 2


class Terminal:
    """A pseudo-terminal, read and written without waiting."""

    def __init__(self):
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.name = os.ttyname(self._slave)

    def readinto(self, buffer):
        try:
            data = os.read(self._master, len(buffer))
        except BlockingIOError:
            return 0
        buffer[: len(data)] = data
        return len(data)

    def write(self, data):
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0


class Radio:
    """A radio that answers at once."""

    def __init__(self):
        self._state = "failed"

    def connect(self, name, password):
        states = {"missing": "not-found", "slow": "joining"}
        is_wrong = password == "wrong-password"
        self._state = "wrong-password" if is_wrong else states.get(name, "joined")

    def disconnect(self):
        self._state = "failed"

    def read_state(self):
        return self._state

    def read_address(self):
        return "127.0.0.1"


terminal, clock = Terminal(), Clock(Time)
network = NetworkLink(clock, BOARD_ID, os.urandom)
sockets = Sockets(socket, select, network, clock, "127.0.0.1", int(port))
wifi = Wifi(Radio(), JsonFile(settings_file), clock, network, BOARD_ID, lambda: sockets)
readings = iter(range(1 << 62))
# Counts that differ from sample to sample, so that samples can be told apart.
converter = InternalAdc([lambda n=n: (next(readings) * 37 + n) % 4096 for n in range(4)], 4096)
board = Board(converter, clock, [SerialLink(terminal), network], lambda on: None, wifi)
udp, tcp = sockets.get_ports()
print(json.dumps({"serial": terminal.name, "udp": udp, "tcp": tcp}), flush=True)
while True:
    if board.loop() > 2000:
        time.sleep(0.0005)
