"""Open Sound Control over UDP: to TouchDesigner, Max, Pure Data, Wekinator, TouchOSC and the like.

Of a frame of `bar`, all in bundles stamped with the time of the sample (NTP, this machine's clock):

    /defsense/bar/control/bend_up      0.42             each control
    /defsense/bar/confidence/bend_up   0.97             0..1
    /defsense/bar/marker/7             x y z radius     mm, in the rest frame; radius 0: not known
    /defsense/bar/quality              3 "trusted"      3 the best to 0 the worst
    /defsense/bar/time                 12.34 567        s on the board's clock (double), number
    /1/fader1 ...                      0.42             TouchOSC's faders on page 1, in their order

and beside them `/wek/inputs` with all controls in one message without a bundle, as Wekinator reads.
Nothing is received: whatever is sent to the port that this sends from is not read.
"""

from __future__ import annotations

import math
import re
import socket
import struct
import time
from functools import lru_cache

from ...core.errors import OutputError
from ..frames.live_frame import LiveFrame
from .output import finite
from .settings import OscSettings

# Messages and bundles of Open Sound Control 1.0 as bytes.
#
# A frame with forty markers takes 0.14 ms here and 0.9 ms with python-osc, in which the loop's thread
# would have to wait for the interpreter; tests read what comes out with python-osc.

_SINCE_1900 = 2_208_988_800  # s, of 1970: NTP counts from 1900
_FORBIDDEN = re.compile(r"[^!-~]|[#*,/?\[\]{}]")  # in a part of an address


class Double(float):
    """A number of which a float of four bytes would lose too much."""


Argument = float | int | str


def message(address: str, *values: Argument) -> bytes:
    """Numbers with a point become floats, `Double`s doubles, whole numbers 32-bit integers, texts
    strings of ASCII."""
    tags = "".join(_tag(value) for value in values)
    head, numbers = _head(address, tags)
    if numbers is not None:
        return head + numbers.pack(*values)
    parts = [head]
    for tag, value in zip(tags, values, strict=True):
        if isinstance(value, str):
            parts.append(_padded(value))
        else:
            parts.append(struct.pack(f">{tag}", value))
    return b"".join(parts)


def bundles(messages: list[bytes], stamp: float, longest: int) -> list[bytes]:
    """Datagrams of at most `longest` bytes, unless one message alone is longer, with the messages
    in bundles of the time `stamp` (s since 1970)."""
    seconds, fraction = divmod(stamp + _SINCE_1900, 1)
    head = b"#bundle\0" + struct.pack(">II", int(seconds) & 0xFFFFFFFF, int(fraction * 2**32))
    out, parts, size = list[bytes](), [head], len(head)
    for content in messages:
        if len(parts) > 1 and size + 4 + len(content) > longest:
            out.append(b"".join(parts))
            parts, size = [head], len(head)
        parts += [struct.pack(">i", len(content)), content]
        size += 4 + len(content)
    out.append(b"".join(parts))
    return out


def address_part(name: str) -> str:
    """A name as part of an address, in which some characters have a meaning."""
    return _FORBIDDEN.sub("_", name) or "_"


def _tag(value: Argument) -> str:
    if isinstance(value, str):
        return "s"
    if isinstance(value, int):
        return "i"
    return "d" if isinstance(value, Double) else "f"


@lru_cache(maxsize=4096)
def _head(address: str, tags: str) -> tuple[bytes, struct.Struct | None]:
    """What stands before the values, and how these are packed where all are numbers."""
    numbers = struct.Struct(f">{tags}") if "s" not in tags else None
    return _padded(address) + _padded(f",{tags}"), numbers


def _padded(text: str) -> bytes:
    """With one to four zeros, to a multiple of four bytes."""
    data = text.encode("ascii", "replace").replace(b"\0", b"?")
    return data + b"\0" * (4 - len(data) % 4)


_LONGEST = 1400  # bytes of a datagram: longer ones are cut up on the way, and lost as a whole


class OscOutput:
    """An `Output` to one receiver."""

    name = "osc"

    def __init__(self, settings: OscSettings) -> None:
        """Raises OutputError where the host is not known."""
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
        self._to = (address[0], settings.port)
        self._wekinator = (address[0], settings.wekinator_port)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.setblocking(False)
        self._full = False

    @property
    def about(self) -> str:
        s = self._settings
        also = f", /wek/inputs to port {s.wekinator_port}" if "wekinator" in s.send else ""
        if "touchosc" in s.send:
            also += f", /{s.page}/fader1 and on"
        return f"osc: sends to {s.host}:{s.port} (UDP){also}"

    @property
    def trouble(self) -> str | None:
        return "osc: the network takes fewer frames than are sent; set rate" if self._full else None

    def send(self, frame: LiveFrame) -> None:
        try:
            if self._send != {"wekinator"}:
                stamp = time.time() - (time.monotonic() - frame.arrived)
                for datagram in bundles(
                    messages(frame, self._send, self._settings.page), stamp, _LONGEST
                ):
                    self._socket.sendto(datagram, self._to)
            if "wekinator" in self._send and frame.controls:
                values = [finite(v) for v in frame.controls.values()]
                self._socket.sendto(message("/wek/inputs", *values), self._wekinator)
            self._full = False
        except BlockingIOError:
            self._full = True  # this frame is lost, as any of UDP may be
        except OSError as error:
            where = f"{self._settings.host}:{self._settings.port}"
            raise OutputError(
                f"cannot send to {where}: {error.strerror}", code="send-failed", where="osc"
            ) from None

    def close(self) -> None:
        self._socket.close()


def messages(frame: LiveFrame, send: frozenset[str], page: int = 1) -> list[bytes]:
    """The messages of a frame, with faders on a `page`; the quality and the time come last."""
    base, out = f"/defsense/{address_part(frame.device)}", []
    if "controls" in send:
        for name, value in frame.controls.items():
            out.append(message(f"{base}/control/{address_part(name)}", finite(value)))
    if "confidence" in send:
        for name, value in frame.confidence.items():
            out.append(message(f"{base}/confidence/{address_part(name)}", finite(value)))
    if "touchosc" in send:
        for n, value in enumerate(frame.controls.values(), 1):
            out.append(message(f"/{page}/fader{n}", finite(value)))
    if "markers" in send:
        rows = zip(frame.ids, frame.markers.tolist(), frame.radius.tolist(), strict=True)
        for number, place, radius in rows:
            if all(map(math.isfinite, place)):
                out.append(message(f"{base}/marker/{number}", *place, finite(radius)))
    if "quality" in send:
        out.append(message(f"{base}/quality", frame.quality.level, str(frame.quality)))
    out.append(message(f"{base}/time", Double(finite(frame.time)), frame.number & 0x7FFFFFFF))
    return out
