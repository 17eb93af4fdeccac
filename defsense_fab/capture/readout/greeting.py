"""Greet a read-out board: bring it to send frames, and to the requested settings."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from ...core.errors import CaptureError
from ...sensing.serial_frames import PROTOCOL, Info, Message, Sample, Stream, Text
from .network_port import NetworkPort

#: Boards restart when their port is opened, and a boot loader may wait for two seconds.
GREETING_TIMEOUT_S = 6.0
COMMAND_RETRY_S = 0.5
_GREETING_BYTES = 400  # of an answer, kept for the error message
_QUOTED_BYTES = 40
_READ_BYTES = 4096


class Transport(Protocol):
    """A two-way byte stream with the methods of pyserial's ports.

    `read` waits for a short time at most. All methods raise OSError when the other end is gone.
    """

    def read(self, size: int) -> bytes: ...

    def write(self, data: bytes) -> int | None: ...

    def close(self) -> None: ...

    @property
    def in_waiting(self) -> int: ...


def read_stamped(port: Transport) -> list[tuple[bytes, int]]:
    """Return bytes that arrived, each with the host's monotonic clock at their arrival, ns."""
    if isinstance(port, NetworkPort):
        return port.read_stamped()
    data = port.read(max(1, min(port.in_waiting, _READ_BYTES)))
    return [(data, time.monotonic_ns())]


@dataclass(frozen=True)
class ReadoutSettings:
    """Settings requested from a read-out board; None leaves a setting as it is.

    Attributes:
        channels: Number of channels to read.
        average: Number of conversions that are summed per sample.
        rate: Samples per second, Hz.
        led: Period of the LED, ms.
    """

    channels: int | None = None
    average: int | None = None
    rate: int | None = None
    led: int | None = None

    def fits(self, sample: Sample) -> bool:
        """Return whether a sample was taken with these settings."""
        return self.channels in (None, len(sample.sums)) and self.average in (
            None,
            sample.averages,
        )

    def next_command(self, info: Info) -> str | None:
        """Return the next command that brings a board to these settings.

        Args:
            info: The board's present settings.

        Returns:
            The command; None if the board has all the settings.
        """
        for command, requested, present in (
            ("channels", self.channels, info.channels),
            ("average", self.average, info.averages),
            ("rate", self.rate, info.rate),
            ("led", self.led, info.led_period),
        ):
            if requested is not None and requested != present:
                return f"{command} {requested}"
        return None


def greet_board(
    port: Transport,
    stream: Stream,
    accept: Callable[[Info], ReadoutSettings],
    name: str,
    stop: threading.Event,
) -> tuple[Info, list[tuple[Sample, int]]]:
    """Request frames until the board describes itself, then send the settings.

    Args:
        port: The port on which the board answers.
        stream: Decoder of the port's bytes.
        accept: Receives each description that the board gives of itself, and returns the requested
            settings; an error that it raises ends the greeting.
        name: Name of the port in messages.
        stop: Ends the greeting early when it is set.

    Returns:
        The board's description, and the samples that arrived meanwhile with their arrival times,
        ns.

    Raises:
        CaptureError: The board is silent, has other firmware or refuses a setting.
        OSError: The port is gone.
    """
    started_at, sent_at, answer = time.monotonic(), 0.0, b""
    stream.reset()
    info: Info | None = None
    settings, early_samples = ReadoutSettings(), list[tuple[Sample, int]]()
    is_set_up, command = False, "frames"
    while time.monotonic() - started_at < GREETING_TIMEOUT_S and not stop.is_set():
        if time.monotonic() - sent_at > COMMAND_RETRY_S:
            sent_at = time.monotonic()
            port.write(f"\n{command}\n".encode("ascii"))
        messages: list[tuple[Message, int]] = []
        for data, arrived_ns in read_stamped(port):
            answer = (answer + data)[-_GREETING_BYTES:]
            messages += [(message, arrived_ns) for message in stream.feed(data)]
        for message, arrived_ns in messages:
            if isinstance(message, Info):
                settings, info, sent_at = accept(message), message, 0.0
                next_command = settings.next_command(info)
                is_set_up, command = next_command is None, next_command or command
            elif isinstance(message, Sample):
                early_samples.append((message, arrived_ns))
            elif isinstance(message, Text) and info is not None:
                raise CaptureError(
                    f"the read-out board refuses the command {command!r}: {message.text}",
                    code="board-command-refused",
                    where=name,
                    action=_update_or(info, "Choose another setting"),
                    command=command,
                )
        if info is not None and is_set_up:
            return info, [(s, at) for s, at in early_samples if settings.fits(s)]
    if info is not None:
        raise CaptureError(
            f"the read-out board does not answer the command {command!r}",
            code="board-command-unanswered",
            where=name,
            action=_update_or(info, "Restart the board and try again"),
            command=command,
        )
    raise _silence_error(answer, name)


def check_info(info: Info, name: str) -> None:
    """Check a board's description of itself.

    Args:
        info: The description.
        name: Name of the port in messages.

    Raises:
        CaptureError: The board speaks another protocol, or finds no converter.
    """
    if info.protocol != PROTOCOL:
        raise CaptureError(
            f"the read-out board's firmware speaks protocol {info.protocol}, this version"
            f" reads {PROTOCOL}",
            code="firmware-protocol-differs",
            where=name,
            action=_update_or(info, "Update defsense-fab"),
            protocol=info.protocol,
        )
    if not info.most_channels:
        raise CaptureError(
            "the read-out board finds no ADS1115",
            code="converter-not-found",
            where=name,
            action="Check the converter's wiring",
        )


def _silence_error(answer: bytes, name: str) -> CaptureError:
    """Explain a port on which no board described itself."""
    if not answer:
        return CaptureError(
            "nothing answers",
            code="board-silent",
            where=name,
            action=(
                "Check that this is the board's port, and write the firmware with defsense board"
                " flash if the board is new"
            ),
        )
    text = answer[-_QUOTED_BYTES:].decode("ascii", "replace")
    return CaptureError(
        f"the device does not run this firmware (it sends {text!r})",
        code="board-firmware-unknown",
        where=name,
        action="Write the firmware with defsense board flash, or choose another port",
        text=text,
    )


def _update_or(info: Info, action: str) -> str:
    """Return what to do about a board: update its firmware if that is older, else `action`."""
    return "Update the firmware with defsense board flash" if info.is_outdated else action
