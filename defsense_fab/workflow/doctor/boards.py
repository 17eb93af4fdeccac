"""Serial ports, and the read-out boards that answer on them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

from ...core.machine.local_access import LOCAL_HOSTS
from .finding import Finding, judged
from .isolated import call

_FOR = "reading the cords of a device"
_CONVERTERS = ("the microcontroller's converter", "ADS1115")


def check_boards(seconds: float, further: Sequence[str]) -> list[Finding]:
    """The ports of the system, and `further` ones that it does not list."""
    listed = call(__name__, "listed", seconds=seconds)
    if listed.trouble:
        return [judged("ports", "ports", False, listed.trouble, needed_for=_FOR)]
    ports = [*listed.value, *further]
    if not ports:
        told = "no serial port is plugged in"
        return [judged("ports", "read-out board", False, told, needed_for=_FOR)]
    return [_check(port, seconds) for port in ports]


def _check(port: str, seconds: float) -> Finding:
    answer = call(__name__, "ask", port, seconds=seconds)
    if answer.trouble:
        told = answer.trouble.removeprefix(f"{port}: ")
        return judged("ports", port, False, told, needed_for=_FOR)
    if way := of_program(port):
        told = f"{answer.value}, but from a program ({way}), such as a twin: this is no board"
        return judged("ports", port, False, told, needed_for=_FOR)
    return judged("ports", port, True, answer.value, needed_for=_FOR)


def of_program(port: str) -> str:
    """How a program of this machine, such as a twin, is behind this port, in words; nothing where a
    read-out board may be: it hangs on USB, or on another machine."""
    if "://" in port:
        try:
            local = urlsplit(port).hostname in LOCAL_HOSTS
        except ValueError:
            local = False
        return "a socket of this machine" if local else ""
    return "a pseudo-terminal" if str(Path(port).resolve()).startswith("/dev/pts/") else ""


def listed() -> list[str]:
    """Devices of the ports that are plugged in."""
    from ...capture.readout.ports import serial_ports

    return [port.device for port in serial_ports()]


def ask(port: str) -> str:
    """What the read-out board says of itself. Raises CaptureError where none answers."""
    from functools import partial

    from ...capture.readout.ports import open_port
    from ...capture.readout.reader import Reader

    with Reader(partial(open_port, port), port) as reader:
        info = reader.info
    assert info is not None
    version = ".".join(map(str, info.version))
    return (
        f"firmware {version} (protocol {info.protocol}), {info.channels} channels by"
        f" {_CONVERTERS[info.converter]}, {info.rate} Hz"
    )
