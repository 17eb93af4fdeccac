"""Send frames by Open Sound Control over UDP (TouchDesigner, Max, Pure Data, TouchOSC and others).

The messages of a frame of the device `bar`:

    /defsense/bar/control/bend_up      0.42             each control
    /defsense/bar/confidence/bend_up   0.97             0..1
    /defsense/bar/marker/7             x y z radius     mm, in the rest frame; radius 0: unknown
    /defsense/knee/target/angle        12.3 2.1 "deg"   a target of a sensor that is no device:
                                                        its numbers, half width and unit
    /defsense/bar/quality              3 "trusted"      3 (the best) to 0
    /defsense/bar/time                 12.34 567        s on the board's clock (double), number
    /1/fader1 ...                      0.42             TouchOSC's faders on page 1, in order

They are sent in bundles with the time of the sample (NTP, this machine's clock), or with the time
tag "immediately": receivers whose clock is behind wait until the time of the sample. For Wekinator,
`/wek/inputs` has all controls in one message without a bundle. Nothing is received: whatever is
sent to the port of this program is ignored.
"""

from __future__ import annotations

import math
import re
import socket
import struct
import time
from functools import lru_cache

from ...core.errors import OutputError
from ..frames.live_frame import LiveFrame, Note
from .output import finite_or_zero
from .settings import OscSettings

_MAX_DATAGRAM_BYTES = 1400  # longer ones are fragmented, and lost as a whole
_SECONDS_1900_TO_1970 = 2_208_988_800  # NTP counts from 1900
_IMMEDIATELY = 0, 1  # time tag
_FORBIDDEN = re.compile(r"[^!-~]|[#*,/?\[\]{}]")  # in a part of an address
_CONGESTED = Note(
    "network-congested", "osc: the network takes fewer frames than are sent; set rate"
)


class Double(float):
    """A number that is encoded with eight bytes, because four would lose too much."""


Argument = float | int | str


def encode_message(address: str, *values: Argument) -> bytes:
    """Encode a message of Open Sound Control 1.0.

    A frame with forty markers takes 0.14 ms here and 0.9 ms with python-osc, during which the
    loop's thread would have to wait for the interpreter.

    Args:
        address: The address.
        values: Floats become floats, `Double` values doubles, integers 32-bit integers, and texts
            ASCII strings.
    """
    tags = "".join(_tag(value) for value in values)
    head, numbers = _encode_head(address, tags)
    if numbers is not None:
        return head + numbers.pack(*values)
    parts = [head]
    for tag, value in zip(tags, values, strict=True):
        if isinstance(value, str):
            parts.append(_pad(value))
        else:
            parts.append(struct.pack(f">{tag}", value))
    return b"".join(parts)


def encode_bundles(messages: list[bytes], stamp: float | None, max_bytes: int) -> list[bytes]:
    """Pack messages into bundles, one per datagram.

    Args:
        messages: Encoded messages.
        stamp: Time of the bundles, s since 1970; None for "immediately".
        max_bytes: Largest size of a datagram, unless a single message is larger.
    """
    tag = _IMMEDIATELY
    if stamp is not None:
        seconds, fraction = divmod(stamp + _SECONDS_1900_TO_1970, 1)
        tag = int(seconds) & 0xFFFFFFFF, int(fraction * 2**32)
    head = b"#bundle\0" + struct.pack(">II", *tag)
    bundles, parts, size = list[bytes](), [head], len(head)
    for content in messages:
        if len(parts) > 1 and size + 4 + len(content) > max_bytes:
            bundles.append(b"".join(parts))
            parts, size = [head], len(head)
        parts += [struct.pack(">i", len(content)), content]
        size += 4 + len(content)
    bundles.append(b"".join(parts))
    return bundles


def address_part(name: str) -> str:
    """Return a name for use in an address, without the characters that are reserved there."""
    return _FORBIDDEN.sub("_", name) or "_"


def _tag(value: Argument) -> str:
    if isinstance(value, str):
        return "s"
    if isinstance(value, int):
        return "i"
    return "d" if isinstance(value, Double) else "f"


@lru_cache(maxsize=4096)
def _encode_head(address: str, tags: str) -> tuple[bytes, struct.Struct | None]:
    """Return the bytes before the values, and the packing of the values if all are numbers."""
    numbers = struct.Struct(f">{tags}") if "s" not in tags else None
    return _pad(address) + _pad(f",{tags}"), numbers


def _pad(text: str) -> bytes:
    """Encode a text with one to four zeros, to a multiple of four bytes."""
    data = text.encode("ascii", "replace").replace(b"\0", b"?")
    return data + b"\0" * (4 - len(data) % 4)


def frame_messages(frame: LiveFrame, send: frozenset[str], page: int = 1) -> list[bytes]:
    """Return the encoded messages of a frame; quality and time come last.

    Args:
        frame: The frame.
        send: Kinds of messages, as in `OscSettings.send`.
        page: Page of TouchOSC's faders.
    """
    base, messages = f"/defsense/{address_part(frame.device)}", []
    if "controls" in send:
        for name, value in frame.controls.items():
            address = f"{base}/control/{address_part(name)}"
            messages.append(encode_message(address, finite_or_zero(value)))
    if "confidence" in send:
        for name, value in frame.confidence.items():
            address = f"{base}/confidence/{address_part(name)}"
            messages.append(encode_message(address, finite_or_zero(value)))
    if "touchosc" in send:
        for n, value in enumerate(frame.controls.values(), 1):
            messages.append(encode_message(f"/{page}/fader{n}", finite_or_zero(value)))
    if "markers" in send:
        rows = zip(frame.ids, frame.markers.tolist(), frame.radius.tolist(), strict=True)
        for k, (number, position, radius) in enumerate(rows):
            if not all(map(math.isfinite, position)):
                continue
            numbers = (*position, finite_or_zero(radius))
            if frame.targets is None:
                messages.append(encode_message(f"{base}/marker/{number}", *numbers))
            else:
                address = f"{base}/target/{address_part(frame.targets.names[k])}"
                messages.append(encode_message(address, *numbers, frame.targets.units[k]))
    if "quality" in send:
        quality = frame.quality
        messages.append(encode_message(f"{base}/quality", quality.level, str(quality)))
    stamp = Double(finite_or_zero(frame.time))
    messages.append(encode_message(f"{base}/time", stamp, frame.number & 0x7FFFFFFF))
    return messages


class OscOutput:
    """An `Output` to one receiver.

    Args:
        settings: Host, ports and kinds of messages.

    Raises:
        OutputError: The host is unknown.
    """

    name = "osc"

    def __init__(self, settings: OscSettings) -> None:
        self._settings, self._send = settings, frozenset(settings.send)
        try:
            family, _, _, _, address = socket.getaddrinfo(
                settings.host, settings.port, type=socket.SOCK_DGRAM
            )[0]
        except (OSError, UnicodeError) as error:
            raise OutputError(
                f"host {settings.host!r} is unknown ({error})",
                code="unknown-host",
                where="osc",
                action="Check host",
                host=settings.host,
            ) from None
        self._receiver = (address[0], settings.port)
        self._wekinator = (address[0], settings.wekinator_port)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.setblocking(False)
        self._is_congested = False

    @property
    def about(self) -> str:
        """Description of what is sent where."""
        s = self._settings
        more = f", /wek/inputs to port {s.wekinator_port}" if "wekinator" in s.send else ""
        if "touchosc" in s.send:
            more += f", faders from /{s.page}/fader1"
        return f"osc: sends to {s.host}:{s.port} (UDP){more}"

    @property
    def trouble(self) -> Note | None:
        """A note if the network drops frames."""
        return _CONGESTED if self._is_congested else None

    def send(self, frame: LiveFrame) -> None:
        """Send the messages of a frame; raise OutputError if the receiver cannot be reached."""
        try:
            if self._send != {"wekinator"}:
                stamp = None
                if not self._settings.immediate:
                    stamp = time.time() - (time.monotonic() - frame.arrived)
                messages = frame_messages(frame, self._send, self._settings.page)
                for datagram in encode_bundles(messages, stamp, _MAX_DATAGRAM_BYTES):
                    self._socket.sendto(datagram, self._receiver)
            if "wekinator" in self._send and frame.controls:
                values = [finite_or_zero(v) for v in frame.controls.values()]
                self._socket.sendto(encode_message("/wek/inputs", *values), self._wekinator)
            self._is_congested = False
        except BlockingIOError:
            self._is_congested = True  # this frame is lost, as datagrams may be
        except OSError as error:
            receiver = f"{self._settings.host}:{self._settings.port}"
            raise OutputError(
                f"cannot send to {receiver}: {error.strerror}", code="send-failed", where="osc"
            ) from None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
