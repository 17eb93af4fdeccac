"""Write flash memory through a boot loader in Python that follows the protocol, and its failures.

`tests/firmware/test_flash.py` writes through the boot loaders of real boards.
"""

import errno

import pytest

from defsense_fab.capture.boards import stk500
from defsense_fab.capture.boards.stk500 import BOOT_SECTION, write_flash
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises

IMAGE = bytes((7 * i + i // 256) % 251 for i in range(1000))
LENGTHS = {b"0": 2, b"A": 3, b"u": 2, b"U": 4, b"Q": 2, b"t": 5, b"d": 5 + 128}


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    for name in ("DTR_OFF_S", "START_S", "QUIET_S", "SYNC_TIMEOUT_S"):
        monkeypatch.setattr(stk500, name, 0.001)


class FakePort:
    """A board's port, which records what happens on its lines.

    Args:
        baud: Speed of the boot loader.
        signature: Signature of the chip.
        gone_after: Number of commands after which the board is unplugged.
        lost: Numbers of commands that the boot loader does not receive.
        bad_cell: Address at which the memory does not keep what is written.
        has_dtr: Whether the port has the lines DTR and RTS.
    """

    def __init__(
        self, baud=115200, signature="1e950f", gone_after=None, lost=(), bad_cell=None, has_dtr=True
    ):
        self.memory = bytearray(b"\xff" * 0x8000)
        self.events, self.commands, self.timeout = [], 0, None
        self._boot_baud, self._signature = baud, bytes.fromhex(signature)
        self._gone_after, self._lost, self._bad_cell = gone_after, lost, bad_cell
        self._has_dtr, self._baud, self._dtr, self.rts = has_dtr, 9600, True, True
        self._address, self._answer, self._is_listening = 0, b"", not has_dtr

    @property
    def baudrate(self):
        return self._baud

    @baudrate.setter
    def baudrate(self, baud):
        self.events.append(baud)
        self._baud = baud

    @property
    def dtr(self):
        return self._dtr

    @dtr.setter
    def dtr(self, is_on):
        if not self._has_dtr:
            raise OSError(errno.ENOTTY, "Inappropriate ioctl for device")
        self.events.append("on" if is_on else "off")
        if is_on and not self._dtr:
            self._is_listening, self._answer = True, b"A0:512.25\r\n"  # of the old program
        self._dtr = is_on

    def read(self, size):
        data, self._answer = self._answer[:size], self._answer[size:]
        return data

    def write(self, data):
        self.commands += 1
        if self._gone_after is not None and self.commands > self._gone_after:
            raise OSError(errno.EIO, "Input/output error")
        if self._baud != self._boot_baud or not self._is_listening or self.commands in self._lost:
            return
        kind = data[:1]
        assert data[-1:] == b" "
        assert len(data) == LENGTHS[kind]
        self._answer += b"\x14" + self._execute(kind, data[1:-1]) + b"\x10"

    def _execute(self, kind, words):
        if kind == b"A":
            return {0x81: b"\x04", 0x82: b"\x04"}.get(words[0], b"\x03")
        if kind == b"u":
            return self._signature
        if kind == b"U":
            self._address = 2 * int.from_bytes(words, "little")
        if kind == b"t":
            size = int.from_bytes(words[:2], "big")
            return bytes(self.memory[self._address : self._address + size])
        if kind == b"d":
            page = slice(self._address, self._address + 128)
            self.memory[page] = words[3:]
            if self._bad_cell is not None and page.start <= self._bad_cell < page.stop:
                self.memory[self._bad_cell] = 0
        if kind == b"Q":
            self._is_listening = False
        return b""


def test_image_is_written_and_started():
    port, stages = FakePort(), []
    boot_loader = write_flash(port, IMAGE, "P", lambda stage, part, _: stages.append((stage, part)))
    assert (boot_loader.baud, boot_loader.version, boot_loader.chip) == (
        115200,
        (4, 4),
        "ATmega328P",
    )
    assert port.memory[: len(IMAGE)] == IMAGE
    assert set(port.memory[len(IMAGE) :]) == {255}
    assert port.events == [115200, "off", "on"]
    parts = {s: [p for stage, p in stages if stage == s] for s in ("connect", "write", "verify")}
    assert all(p == sorted(p) and p[-1] == 1 for p in parts.values())


def test_speeds_are_tried_in_turn_each_after_a_reset():
    port = FakePort(57600)
    assert write_flash(port, IMAGE, "P").baud == 57600
    assert port.events == [115200, "off", "on", 57600, "off", "on"]


def test_port_without_dtr_waits_for_the_reset_button():
    port = FakePort(has_dtr=False)
    write_flash(port, IMAGE, "P")
    assert port.memory[: len(IMAGE)] == IMAGE


def test_silent_board_is_reset_at_each_speed_several_times():
    port = FakePort(9600)
    with raises(CaptureError, "boot-loader-silent"):
        write_flash(port, IMAGE, "P")
    speeds = [e for e in port.events if isinstance(e, int)]
    assert speeds == [115200, 57600] * stk500.ROUNDS
    assert port.events.count("on") == len(speeds)


@pytest.mark.parametrize(
    ("signature", "chip"), [("1e9406", "ATmega168"), ("1e9587", "ATmega32U4"), ("000000", None)]
)
def test_other_chip_is_refused_before_anything_is_written(signature, chip):
    port = FakePort(signature=signature)
    with raises(CaptureError, "chip-not-supported", chip=chip):
        write_flash(port, IMAGE, "P")
    assert set(port.memory) == {255}


def test_damaged_memory_is_reported():
    port = FakePort(bad_cell=300)
    with raises(CaptureError, "flash-verify-failed", address=300):
        write_flash(port, IMAGE, "P")


@pytest.mark.parametrize("size", [0, BOOT_SECTION + 1, 0x8000])
def test_image_of_another_size_is_refused(size):
    port = FakePort()
    with raises(CaptureError, "image-out-of-range", size=size):
        write_flash(port, bytes(size), "P")
    assert port.events == []


def test_largest_image_leaves_the_boot_loader_alone():
    port = FakePort()
    write_flash(port, bytes(BOOT_SECTION), "P")
    assert set(port.memory[BOOT_SECTION:]) == {255}


@pytest.mark.parametrize("command", range(20))
def test_lost_command_is_repeated_after_a_reset(command):
    port = FakePort(lost={command})
    write_flash(port, IMAGE, "P")
    assert port.memory[: len(IMAGE)] == IMAGE


def test_board_that_stops_answering_is_reported():
    port = FakePort(lost=range(12, 1000))
    with raises(CaptureError, "flash-interrupted", is_incomplete=True):
        write_flash(port, IMAGE, "P")


@pytest.mark.parametrize("count", range(4 + 4 * 8 + 1))
def test_board_that_is_unplugged_is_reported(count):
    """Whatever the command at which it happens; the error says whether the program may be lost."""
    port = FakePort(gone_after=count)
    with raises(CaptureError, "flash-interrupted") as caught:
        write_flash(port, IMAGE, "P")
    assert caught.value.data["is_incomplete"] or set(port.memory) == {255}
