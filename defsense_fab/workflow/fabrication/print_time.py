"""Estimate how long a device takes to print: volume by rate, and a time for each layer.

The one model of print time: a solid piece takes its volume divided by the printer's rate, and in
each of its layers the nozzle travels to it and starts again. Report, guide, terminal and studio
show the times of this model, and the guide advises the speed that belongs to the same rate.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import ceil, pi

import numpy as np

from ...core.device.device import FabricationSpec
from ...geometry.parts.records import PartSet
from ...store.manifest import Manifest, Plate
from ...store.printed_pieces import PrintedPiece

#: Time of a piece in each of its layers for travel, retraction and slow outer walls: 2.3 s in
#: PrusaSlicer's estimate for the peg of the fit coupon, rounded.
LAYER_S = 2.0
_HOUR_S = 3600.0


def print_hours(fabrication: FabricationSpec, pieces: Iterable[PrintedPiece]) -> float | None:
    """Estimate how long solid pieces take to print, h.

    Args:
        fabrication: How the device is made.
        pieces: The pieces, each as often as it is printed.

    Returns:
        The time; None for moulds, and for processes without a rate, whose time depends on the
        machine.
    """
    if fabrication.kind != "print" or fabrication.rate is None:
        return None
    seconds = 0.0
    for piece in pieces:
        layers = ceil(piece.height / fabrication.layer)
        seconds += piece.volume / fabrication.rate + layers * LAYER_S
    return seconds / _HOUR_S


def describe_speed(fabrication: FabricationSpec) -> str:
    """Return the advised speed of the nozzle, as in "at about 25 mm/s (2 mm3/s)"."""
    if fabrication.rate is None:
        return "slowly"
    speed = fabrication.rate / (fabrication.line * fabrication.layer)
    return f"at about {speed:.0f} mm/s ({fabrication.rate:.2g} mm3/s)"


def pieces_of_parts(parts: PartSet) -> tuple[PrintedPiece, ...]:
    """Return the parts, pins and traces of a device as they are printed."""
    pieces = [
        PrintedPiece(p.volume, float(np.ptp(p.surface.vertices @ p.down)))
        for p in (*parts.parts, *parts.traces)
    ]
    pins = (PrintedPiece(pin_volume(p.diameter, p.length), p.length) for p in parts.pins)
    return (*pieces, *pins)


def pieces_on_plate(manifest: Manifest, plate: Plate) -> tuple[PrintedPiece, ...]:
    """Return the pieces on a plate, copies included."""
    volumes = _volumes(manifest)
    return tuple(
        PrintedPiece(volumes[name], float(np.ptp(bounds[:, 2])))
        for name, bounds in plate.parts.items()
    )


def _volumes(manifest: Manifest) -> Mapping[str, float]:
    """Return the volume (mm^3) of each piece on the plates, by its name there."""
    if manifest.traces:
        return {"body": manifest.parts[0].volume, **{t.name: t.volume for t in manifest.traces}}
    moulds = {q.name: q.volume for mould in manifest.moulds for q in mould.pieces}
    volumes = dict(moulds)
    for part in () if moulds else manifest.parts:
        copies = (f"_{k + 1}" if k else "" for k in range(manifest.copies))
        volumes |= {f"{part.name}{copy}": part.volume for copy in copies}
    for pin in manifest.pins:
        count = pin.count * manifest.copies
        volume = pin_volume(pin.diameter, pin.length)
        volumes |= {f"{pin.name}_{k + 1}": volume for k in range(count)}
    return volumes


def pin_volume(diameter: float, length: float) -> float:
    """Return the volume (mm^3) of a pin with its diameter and length, mm, without its bevels."""
    return pi / 4 * diameter**2 * length
