"""Serial ports, sockets and network connections of read-out boards."""

from __future__ import annotations

import errno
import sys
from dataclasses import dataclass
from urllib.parse import urlsplit

import serial
from serial.tools import list_ports

from ...core.errors import CaptureError
from .greeting import Transport
from .network_port import NetworkPort
from .network_url import is_network_url, parse_network_url

BAUD = 115200
READ_TIMEOUT_S = 0.05
WRITE_TIMEOUT_S = 2.0


@dataclass(frozen=True)
class Port:
    """A serial port that is plugged in.

    Attributes:
        device: Name by which the port is opened, such as `/dev/ttyUSB0` or `COM3`.
        description: Description that the port gives of itself; empty if none.
    """

    device: str
    description: str


def serial_ports() -> list[Port]:
    """List the serial ports that belong to a device.

    Ports without an address on a bus are left out.
    """
    ports = sorted(list_ports.comports(), key=lambda p: p.device)
    return [
        Port(p.device, p.description if p.description != "n/a" else "")
        for p in ports
        if p.hwid != "n/a" or p.vid is not None
    ]


def find_only_port() -> str:
    """Return the name of the serial port, if exactly one is plugged in.

    Raises:
        CaptureError: No port is plugged in (`board-not-found`), or several are (`port-ambiguous`).
    """
    ports = serial_ports()
    devices = [p.device for p in ports]
    if not ports:
        raise CaptureError(
            "no serial port is plugged in",
            code="board-not-found",
            action="Plug the board in with a cable that carries data; some cables only charge",
            ports=devices,
        )
    if len(ports) > 1:
        names = ", ".join(
            f"{p.device} ({p.description})" if p.description else p.device for p in ports
        )
        raise CaptureError(
            f"{len(ports)} serial ports are plugged in: {names}",
            code="port-ambiguous",
            where="port",
            action="Choose one of them",
            ports=devices,
        )
    return devices[0]


def open_port(url: str) -> Transport:
    """Open a serial port, a socket, or a connection to a board with Wi-Fi.

    Args:
        url: A device (`/dev/ttyUSB0`, `/dev/cu.usbmodem1`, `COM3`), `socket://host:port`, or
            `udp://...` or `tcp://...` as of `parse_network_url`.

    Raises:
        CaptureError: If the port is absent, busy, or may not be opened; for boards with Wi-Fi, see
            `parse_network_url` and `NetworkPort`.
    """
    if is_network_url(url):
        return NetworkPort(parse_network_url(url))
    _check_socket(url)
    try:
        port = serial.serial_for_url(url, do_not_open=True)
        port.baudrate, port.timeout, port.write_timeout = BAUD, READ_TIMEOUT_S, WRITE_TIMEOUT_S
        if "://" not in url:
            port.exclusive = True
        port.open()
    except Exception as error:  # SerialException, OSError, ValueError, termios.error
        raise _port_error(url, error) from None
    return port  # type: ignore[no-any-return]


def _check_socket(url: str) -> None:
    """Refuse a socket without a host or a valid port number."""
    if not url.startswith("socket://"):
        return
    try:
        parts = urlsplit(url)
        is_valid = bool(parts.hostname and parts.port)
    except ValueError:
        is_valid = False
    if not is_valid:
        raise CaptureError(
            "is not the address of a socket",
            code="port-url-invalid",
            where=url,
            action="Write socket://host:port, with a port number from 1 to 65535",
            port=url,
        )


def _port_error(url: str, error: Exception) -> CaptureError:
    """Explain why a port could not be opened."""
    number = getattr(error, "errno", None)
    text = str(error)
    is_locked = "exclusively lock" in text or (
        sys.platform == "win32" and "PermissionError" in text
    )
    if number in (errno.EAGAIN, errno.EBUSY) or is_locked:
        return CaptureError(
            "is in use by another program",
            code="port-busy",
            where=url,
            action="Close the other program, such as the serial monitor of the Arduino IDE",
            port=url,
        )
    if number == errno.EACCES:
        return CaptureError(
            "permission denied",
            code="port-forbidden",
            where=url,
            action=(
                "On Linux join the group 'dialout' (sudo usermod -aG dialout $USER) and log in"
                " again"
            ),
            port=url,
        )
    devices = [p.device for p in serial_ports()]
    names = ", ".join(devices) or "none"
    if number in (errno.ENOENT, errno.ENXIO) or "FileNotFoundError" in text:
        return CaptureError(
            f"there is no such port; ports plugged in: {names}",
            code="port-not-found",
            where=url,
            action="Plug the board in, or run defsense doctor for details",
            port=url,
            ports=devices,
        )
    return CaptureError(
        f"cannot be opened ({text}); ports plugged in: {names}",
        code="port-unavailable",
        where=url,
        action="Choose another port",
        port=url,
        ports=devices,
    )
