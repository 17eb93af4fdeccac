"""Arrange parts, moulds and loose pins on print plates, and write the plates."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...core.device.device import Device
from ...core.mesh import Surface
from ...geometry.kernels import triangle_kernel
from ...geometry.parts.records import PartSet
from ...geometry.printing.export import write_3mf, write_stl
from ...geometry.printing.print_bed import PlacedPart, arrange, count_fewest_plates
from ...store.manifest import PinRecord, Plate

#: Folder in parts/ of pieces in print orientation; parts/ itself has them in device coordinates.
LYING = "print"


def pin_kinds(part_set: PartSet) -> dict[str, tuple[Surface, int, dict[str, float]]]:
    """Return every kind of loose pin.

    Args:
        part_set: The parts of a device.

    Returns:
        For each name of a kind: its surface, how many a device needs, and its sizes in mm.
    """
    kinds: dict[str, tuple[Surface, int, dict[str, float]]] = {}
    for pin in part_set.pins:
        name = f"pin-{pin.diameter:g}x{pin.length:.1f}"
        if name in kinds:
            surface, count, sizes = kinds[name]
            kinds[name] = (surface, count + 1, sizes)
        else:
            solid = triangle_kernel.union([triangle_kernel.solid_of(t) for t in pin.shape])
            sizes = {"diameter": pin.diameter, "length": pin.length}
            kinds[name] = (triangle_kernel.to_printable_surface(solid, name), 1, sizes)
    return kinds


def on_plates(
    device: Device,
    lying: Mapping[str, Surface],
    pins: Mapping[str, tuple[Surface, int, Mapping[str, float]]],
) -> tuple[dict[str, PlacedPart], int]:
    """Arrange pieces on plates.

    Parts are printed once for each copy of the device; moulds are printed once, as all copies are
    cast in them.

    Args:
        device: The device.
        lying: Surfaces in print orientation, by name.
        pins: The kinds of pins, as `pin_kinds` returns them.

    Returns:
        The placed pieces by name, and the smallest number of plates that could hold them.

    Raises:
        FabricationError: A piece is too large for the bed.
    """
    fabrication = device.fabrication
    copies = fabrication.copies if fabrication.kind == "print" else 1
    pieces = {
        name if k == 0 else f"{name}_{k + 1}": surface
        for k in range(copies)
        for name, surface in lying.items()
    }
    for name, (surface, count, _) in pins.items():
        pieces |= {f"{name}_{k + 1}": surface for k in range(count * fabrication.copies)}
    min_plates = count_fewest_plates(
        pieces, fabrication.bed, fabrication.process, fabrication.spacing
    )
    return arrange(pieces, fabrication.bed, fabrication.process, fabrication.spacing), min_plates


def write_plates(placed: Mapping[str, PlacedPart], out: Path, title: str) -> tuple[Plate, ...]:
    """Write a 3MF file for each plate; a slicer can move each piece on it.

    Args:
        placed: The placed pieces, by name.
        out: The folder to write to.
        title: Title of the files.

    Returns:
        Records of the plates.
    """
    plates = []
    count = 1 + max(p.plate for p in placed.values())
    for k in range(count):
        surfaces = {n: p.surface for n, p in placed.items() if p.plate == k}
        file = "plate.3mf" if count == 1 else f"plate-{k + 1}.3mf"
        write_3mf(surfaces, out / file, title, together=False)
        plates.append(Plate(file, {n: s.bounds for n, s in surfaces.items()}))
    return tuple(plates)


def write_pins(
    pins: Mapping[str, tuple[Surface, int, Mapping[str, float]]], out: Path
) -> tuple[PinRecord, ...]:
    """Write an STL file for each kind of pin, and return the records of the pins."""
    for name, (surface, _, _) in pins.items():
        write_stl(surface, out / LYING / f"{name}.stl")
    return tuple(
        PinRecord(n, f"{LYING}/{n}.stl", count, **sizes) for n, (_, count, sizes) in pins.items()
    )
