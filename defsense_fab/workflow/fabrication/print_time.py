"""Estimate how long the parts of a device take to print."""

from __future__ import annotations

from ...core.device.device import FabricationSpec

#: Speed of the nozzle with soft filament; assumed, as printers and filaments differ.
SPEED_MM_S = 25.0
#: Time of each part for travel to it in each layer; assumed.
PART_S = 120.0
_FILAMENT = "fdm"  # processes with names that begin so extrude filament
_HOUR_S = 3600.0


def print_hours(fabrication: FabricationSpec, volume: float, parts: int) -> float | None:
    """Estimate how long solid parts of filament take to print, h.

    The time of other processes depends on the machine, so that it is not estimated.

    Args:
        fabrication: How the device is made.
        volume: Volume of all parts of one device, mm^3.
        parts: Number of parts of one device.

    Returns:
        The time of all copies, or None if the process has no estimate.
    """
    if fabrication.kind != "print" or not fabrication.process.startswith(_FILAMENT):
        return None
    flow = fabrication.line * fabrication.layer * SPEED_MM_S
    return fabrication.copies * (volume / flow + parts * PART_S) / _HOUR_S
