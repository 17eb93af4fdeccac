"""What is printed: parts or moulds, and loose pins, as they lie, on plates."""

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

#: The folder in parts/ of what lies as it is printed; beside it parts stand where they belong.
LYING = "print"


def pin_kinds(made: PartSet) -> dict[str, tuple[Surface, int, dict[str, float]]]:
    """Every kind of loose pin: its surface, how many a device needs, its sizes."""
    kinds: dict[str, tuple[Surface, int, dict[str, float]]] = {}
    for pin in made.pins:
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
    """What lies as it is printed, arranged, and the number of plates below which that cannot be.

    Printed parts come as often as there are copies of the device; moulds once, for all copies are
    cast in them. Raises FabricationError for what no plate holds.
    """
    f = device.fabrication
    again = f.copies if f.kind == "print" else 1
    pieces = {
        name if k == 0 else f"{name}_{k + 1}": surface
        for k in range(again)
        for name, surface in lying.items()
    }
    for name, (surface, count, _) in pins.items():
        pieces |= {f"{name}_{k + 1}": surface for k in range(count * f.copies)}
    bound = count_fewest_plates(pieces, f.bed, f.process, f.spacing)
    return arrange(pieces, f.bed, f.process, f.spacing), bound


def write_plates(placed: Mapping[str, PlacedPart], out: Path, title: str) -> tuple[Plate, ...]:
    """A 3MF file for each plate, each piece on it an item that a slicer can move."""
    plates = []
    count = 1 + max(p.plate for p in placed.values())
    for k in range(count):
        on = {n: p.surface for n, p in placed.items() if p.plate == k}
        file = "plate.3mf" if count == 1 else f"plate-{k + 1}.3mf"
        write_3mf(on, out / file, title, together=False)
        plates.append(Plate(file, {n: s.bounds for n, s in on.items()}))
    return tuple(plates)


def write_pins(
    pins: Mapping[str, tuple[Surface, int, Mapping[str, float]]], out: Path
) -> tuple[PinRecord, ...]:
    """An STL file for each kind of pin."""
    for name, (surface, _, _) in pins.items():
        write_stl(surface, out / LYING / f"{name}.stl")
    return tuple(
        PinRecord(n, f"{LYING}/{n}.stl", count, **sizes) for n, (_, count, sizes) in pins.items()
    )
