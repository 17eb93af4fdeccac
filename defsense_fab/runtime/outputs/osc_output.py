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
import socket
import time

from ...core.errors import OutputError
from ..frames.live_frame import LiveFrame
from .osc_encoding import Double, address_part, bundles, message
from .output import finite
from .settings import OscSettings

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
