"""Write the flash memory of an Arduino through its boot loader, in the protocol STK500 version 1.

Two boot loaders are in use on boards with an ATmega328P. Optiboot (Uno, and Nanos since 2018)
listens at 115200 baud for a second after a reset. ATmegaBOOT (older Nanos) listens at 57600 baud
for about two seconds. Both ignore the commands that configure a programmer, erase each page as
they write it, and cannot write the section that they are in. A byte that Optiboot does not expect
makes it start the program, so that a session that is out of step starts again with a reset.

References:
    Atmel, AVR061: STK500 Communication Protocol, 2003.
"""

from __future__ import annotations

import contextlib
import errno
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol, TypeVar

from ...core.errors import CaptureError
from ...core.progress import Progress, silent

#: Speeds of Optiboot and of ATmegaBOOT; 115200 baud is garbage to ATmegaBOOT and vice versa.
BAUD_RATES = (115200, 57600)
#: Resets per speed. On a board that the port does not reset, its button can be pressed meanwhile.
ROUNDS = 3
PAGE_BYTES = 128
#: Start of the larger boot loader's section (ATmegaBOOT, 2 KB) in the 32 KB of the chip.
BOOT_SECTION = 0x7800
#: Chips that run programs for the ATmega328P.
CHIPS = {
    bytes.fromhex("1e950f"): "ATmega328P",
    bytes.fromhex("1e9514"): "ATmega328",
    bytes.fromhex("1e9516"): "ATmega328PB",
}
OTHER_CHIPS = {
    bytes.fromhex("1e9307"): "ATmega8",
    bytes.fromhex("1e9406"): "ATmega168",
    bytes.fromhex("1e940b"): "ATmega168P",
    bytes.fromhex("1e9587"): "ATmega32U4",
    bytes.fromhex("1e9705"): "ATmega1284P",
    bytes.fromhex("1e9801"): "ATmega2560",
}
#: The capacitor between DTR and the reset pin charges while DTR is off, and then pulls it down.
DTR_OFF_S = 0.25
#: The boot loader's serial port is ready after this time.
START_S = 0.1
#: A boot loader first flashes the LED for up to 0.4 s.
SYNC_TIMEOUT_S = 0.5
SYNC_TRIES = 3
ANSWER_TIMEOUT_S = 1.0  # a page of 128 bytes takes 22 ms at 57600 baud, and 10 ms to be written
QUIET_S = 0.05
#: Sessions that are started again for one page before the work is given up.
PAGE_TRIES = 3

_GET_SYNC, _GET_PARAMETER, _LEAVE = b"0", b"A", b"Q"
_LOAD_ADDRESS, _WRITE_PAGE, _READ_PAGE, _READ_SIGNATURE = b"U", b"d", b"t", b"u"
_FLASH, _END = b"F", b" "
_IN_SYNC, _OK = b"\x14", b"\x10"
_SOFTWARE_MAJOR, _SOFTWARE_MINOR = b"\x81", b"\x82"
_T = TypeVar("_T")


class BootPort(Protocol):
    """A serial port with the properties of pyserial's ports.

    All methods raise OSError when the board is gone. `read` returns what has arrived when its
    timeout is over.
    """

    baudrate: int
    timeout: float | None
    dtr: bool
    rts: bool

    def read(self, size: int) -> bytes: ...

    def write(self, data: bytes) -> int | None: ...


@dataclass(frozen=True)
class BootLoader:
    """A boot loader that answers.

    Attributes:
        baud: Its speed, baud.
        version: Its version; 1.16 is ATmegaBOOT.
        chip: Name of the chip.
    """

    baud: int
    version: tuple[int, int]
    chip: str


class _OutOfStepError(Exception):
    """The boot loader did not answer, or answered something else."""


def write_flash(port: BootPort, image: bytes, name: str, progress: Progress = silent) -> BootLoader:
    """Write an image to the flash memory, read it back and start it.

    Args:
        port: Serial port of the board.
        image: Contents of the memory from address 0.
        name: Name of the port, for messages.
        progress: Called during the stages `connect`, `write` and `verify`.

    Returns:
        The boot loader that wrote the image.

    Raises:
        CaptureError: The image does not fit (`image-out-of-range`), no boot loader answers
            (`boot-loader-silent`), the chip cannot run the image (`chip-not-supported`), the memory
            differs after it was written (`flash-verify-failed`), or the board was unplugged
            or stopped answering in between (`flash-interrupted`).
    """
    if not image or len(image) > BOOT_SECTION:
        raise CaptureError(
            f"the image has {len(image)} bytes, the chip has {BOOT_SECTION} below its boot loader",
            code="image-out-of-range",
            where=name,
            action="Use the image of another converter or board",
            size=len(image),
            limit=BOOT_SECTION,
        )
    session, is_written = _Session(port), False
    try:
        boot_loader = session.connect(name, progress)
        progress("connect", 1, "done")
        is_written = True  # from now on the old program may be lost
        pages = [(a, image[a : a + PAGE_BYTES]) for a in range(0, len(image), PAGE_BYTES)]
        for address, page in _steps("write", pages, progress):
            session.repeat(lambda a=address, p=page: session.write_page(a, p))  # type: ignore[misc]
        for address, page in _steps("verify", pages, progress):
            found = session.repeat(lambda a=address, p=page: session.read_page(a, len(p)))  # type: ignore[misc]
            if found != page:
                raise _verify_error(name, address, page, found)
        with contextlib.suppress(_OutOfStepError):  # it starts the program in any case
            session.command(_LEAVE)
    except (OSError, _OutOfStepError) as error:
        raise _interrupted_error(name, error, is_written) from None
    return boot_loader


def _steps(
    stage: str, pages: list[tuple[int, bytes]], progress: Progress
) -> Iterator[tuple[int, bytes]]:
    """Yield the pages, and report the progress."""
    for number, page in enumerate(pages):
        progress(stage, number / len(pages), f"{number * PAGE_BYTES} bytes")
        yield page
    progress(stage, 1, "done")


class _Session:
    """The commands of the protocol, on a port.

    Each command ends with a space. The answer begins with 0x14 and ends with 0x10.
    """

    def __init__(self, port: BootPort) -> None:
        self._port = port

    def connect(self, name: str, progress: Progress) -> BootLoader:
        """Reset the board until a boot loader answers, at each speed in turn."""
        attempts = BAUD_RATES * ROUNDS
        for number, baud in enumerate(attempts):
            hint = "" if number < len(BAUD_RATES) else "; press the board's reset button repeatedly"
            progress("connect", number / len(attempts), f"trying {baud} baud{hint}")
            try:
                self._synchronize(baud)
                version = self._parameter(_SOFTWARE_MAJOR), self._parameter(_SOFTWARE_MINOR)
                signature = self.command(_READ_SIGNATURE, answer=3)
            except _OutOfStepError:
                continue
            if signature not in CHIPS:
                raise _chip_error(name, signature)
            return BootLoader(baud, version, CHIPS[signature])
        raise CaptureError(
            "no boot loader answers",
            code="boot-loader-silent",
            where=name,
            action=(
                "Check that this is an Arduino Nano or Uno, run the command again, and press the"
                " board's reset button about once a second until the progress moves"
            ),
            baud_rates=BAUD_RATES,
        )

    def repeat(self, work: Callable[[], _T]) -> _T:
        """Do something, and start the session again if it gets out of step."""
        for _ in range(PAGE_TRIES - 1):
            try:
                return work()
            except _OutOfStepError:
                with contextlib.suppress(_OutOfStepError):
                    self._synchronize(self._port.baudrate)
        return work()

    def write_page(self, address: int, page: bytes) -> None:
        """Write a page of the flash memory; shorter ones are filled with 0xFF."""
        data = page.ljust(PAGE_BYTES, b"\xff")
        self._load_address(address)
        self.command(_WRITE_PAGE + PAGE_BYTES.to_bytes(2, "big") + _FLASH + data)

    def read_page(self, address: int, size: int) -> bytes:
        """Read flash memory."""
        self._load_address(address)
        return self.command(_READ_PAGE + size.to_bytes(2, "big") + _FLASH, answer=size)

    def command(self, command: bytes, answer: int = 0) -> bytes:
        """Send a command, and return as many bytes of its answer."""
        self._port.write(command + _END)
        self._port.timeout = ANSWER_TIMEOUT_S
        data = self._port.read(answer + 2)
        if len(data) != answer + 2 or data[:1] != _IN_SYNC or data[-1:] != _OK:
            raise _OutOfStepError(f"unexpected answer {data[:8].hex(' ') or 'of no bytes'}")
        return data[1:-1]

    def _synchronize(self, baud: int) -> None:
        """Reset the board, and wait for an answer of its boot loader."""
        port = self._port
        port.baudrate = baud
        self._set_reset_lines(False)
        time.sleep(DTR_OFF_S)
        self._set_reset_lines(True)
        time.sleep(START_S)
        self._discard_input()  # of the program that ran before
        for _ in range(SYNC_TRIES):
            port.write(_GET_SYNC + _END)
            is_in_sync = self._wait_for(_IN_SYNC + _OK)
            self._discard_input()  # answers to earlier attempts
            if is_in_sync:
                return
        raise _OutOfStepError("no answer")

    def _set_reset_lines(self, is_on: bool) -> None:
        """Switch DTR and RTS, of which one is connected to the reset pin, if the port has them."""
        try:
            self._port.dtr = self._port.rts = is_on
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTTY):
                raise

    def _wait_for(self, answer: bytes) -> bool:
        """Return whether an answer arrives, also behind other bytes."""
        end, received = time.monotonic() + SYNC_TIMEOUT_S, b""
        while (remaining := end - time.monotonic()) > 0:
            self._port.timeout = remaining
            received = received[-1:] + self._port.read(1)
            if received == answer:
                return True
        return False

    def _discard_input(self) -> None:
        """Discard bytes until the line is quiet."""
        end = time.monotonic() + SYNC_TIMEOUT_S
        self._port.timeout = QUIET_S
        while time.monotonic() < end and self._port.read(256):
            pass

    def _parameter(self, name: bytes) -> int:
        return self.command(_GET_PARAMETER + name, answer=1)[0]

    def _load_address(self, address: int) -> None:
        """Set the address of the next page; boot loaders count words."""
        self.command(_LOAD_ADDRESS + (address // 2).to_bytes(2, "little"))


def _chip_error(name: str, signature: bytes) -> CaptureError:
    text = signature.hex(" ")
    chip = OTHER_CHIPS.get(signature)
    return CaptureError(
        f"the board has an {chip} (signature {text})"
        if chip
        else f"the board's chip has the unknown signature {text}",
        code="chip-not-supported",
        where=name,
        action="Use an Arduino Nano or Uno with an ATmega328P",
        signature=text,
        chip=chip,
    )


def _verify_error(name: str, address: int, expected: bytes, found: bytes) -> CaptureError:
    pairs = zip(expected, found, strict=True)
    first = address + next(i for i, (a, b) in enumerate(pairs) if a != b)
    return CaptureError(
        f"the memory differs from what was written, first at address {first:#06x}",
        code="flash-verify-failed",
        where=name,
        action="Run the command again; if it fails at the same address, replace the board",
        address=first,
    )


def _interrupted_error(name: str, error: Exception, is_written: bool) -> CaptureError:
    state = (
        "The program on the board may be incomplete, its boot loader is unchanged"
        if is_written
        else "The board is unchanged"
    )
    return CaptureError(
        f"writing the firmware was interrupted ({error}). {state}",
        code="flash-interrupted",
        where=name,
        action="Plug the board in and run the command again",
        is_incomplete=is_written,
    )
