"""Serial ports and sockets: opening them, and which there are."""

from __future__ import annotations

import errno
import sys
from dataclasses import dataclass

import serial
from serial.tools import list_ports

from ...core.errors import CaptureError
from .reader import Transport

BAUD = 115200
_WAIT = 0.05  # s that a read waits


@dataclass(frozen=True)
class Port:
    """A port that is plugged in: its device, and what it says of itself."""

    device: str
    description: str


def ports() -> list[Port]:
    """Serial ports that belong to something: those without an address on a bus are left out."""
    found = sorted(list_ports.comports(), key=lambda p: p.device)
    return [
        Port(p.device, p.description if p.description != "n/a" else "")
        for p in found
        if p.hwid != "n/a" or p.vid is not None
    ]


def open_port(url: str) -> Transport:
    """A port by its device (/dev/ttyUSB0, /dev/cu.usbmodem1, COM3) or a socket (socket://host:port).

    Raises CaptureError where it is absent, busy or not ours to open.
    """
    try:
        port = serial.serial_for_url(url, do_not_open=True)
        port.baudrate, port.timeout, port.write_timeout = BAUD, _WAIT, 2.0
        if "://" not in url:
            port.exclusive = True
        port.open()
    except Exception as error:  # SerialException, OSError, ValueError, termios.error
        raise _port_error(url, error) from None
    return port  # type: ignore[no-any-return]


def _port_error(url: str, error: Exception) -> CaptureError:
    number = getattr(error, "errno", None)
    text = str(error)
    taken = "exclusively lock" in text or (sys.platform == "win32" and "PermissionError" in text)
    if number in (errno.EAGAIN, errno.EBUSY) or taken:
        return CaptureError(
            f"{url}: is in use by another program (the Arduino IDE's monitor?); close that",
            code="port-busy",
            port=url,
        )
    if number == errno.EACCES:
        return CaptureError(
            f"{url}: you may not open it; on Linux join the group 'dialout' (sudo usermod -aG"
            " dialout $USER) and log in again",
            code="port-forbidden",
            port=url,
        )
    have = [p.device for p in ports()]
    names = ", ".join(have) or "none"
    if number in (errno.ENOENT, errno.ENXIO) or "FileNotFoundError" in text:
        return CaptureError(
            f"{url}: there is no such port; plugged in: {names}; defsense doctor tells more",
            code="port-not-found",
            port=url,
            ports=have,
        )
    return CaptureError(
        f"{url}: cannot be opened ({text}); plugged in: {names}",
        code="port-unavailable",
        port=url,
        ports=have,
    )
