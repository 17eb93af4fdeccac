"""What a device's cords can be read from: its twin, ports, and what was recorded."""

from __future__ import annotations

from dataclasses import dataclass

from ...capture.readout.ports import serial_ports
from ...capture.sessions.known_sessions import known_sessions
from ...core.device.device import Device
from .raw_recording import BOARD

TWIN = "twin"
_RECENT = 5  # of the runs that were kept


@dataclass(frozen=True)
class KnownPort:
    """A `port` as `RunOptions` takes it, and what to call it."""

    port: str
    label: str


def known_ports(device: Device) -> list[KnownPort]:
    """The twin first, which is always there; then serial ports, sessions and kept runs."""
    out = [KnownPort(TWIN, "twin (simulated)")]
    out += [KnownPort(p.device, f"{p.device} {p.description}".strip()) for p in serial_ports()]
    for session in known_sessions(device):
        if session.problem is None:
            name = session.folder.relative_to(device.source)
            out.append(KnownPort(f"replay:{session.folder}", f"session {name}"))
    runs = sorted(device.source.glob(f"live/*/{BOARD}"), reverse=True)[:_RECENT]
    return out + [KnownPort(f"replay:{p}", f"run of {p.parent.name}") for p in runs]
