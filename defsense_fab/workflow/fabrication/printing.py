"""Prepare the printing of a device: plates of parts, moulds and pins, and advice by process."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.mesh import Surface
from ...geometry.kernels import triangle_kernel
from ...geometry.parts.alignment_pins import Pin
from ...geometry.parts.records import PartSet
from ...geometry.printing.export import write_3mf, write_stl
from ...geometry.printing.overhangs import Overhang, measure_overhang
from ...geometry.printing.print_bed import (
    MIN_FIRST_LAYER_MM2,
    PlacedPart,
    arrange,
    count_fewest_plates,
    first_layer_area,
)
from ...store.manifest import PinRecord, Plate
from .print_time import describe_speed

#: Folder in parts/ of pieces in print orientation; parts/ itself has them in device coordinates.
LYING = "print"
#: Feedstock by the first word of a process; a process that the user added may have none.
_FEEDSTOCKS = {
    "fdm": "filament",
    "polyjet": "jets",
    "sla": "resin",
    "sls": "powder",
    "cast": "mould",
}
MIN_SAME_SIDE_COSINE = 0.999  # of directions that are one side of a part
_MIN_MOULD_SHELL_MM = 1.2  # thinner shells leak
_MAX_MOULD_LAYER_MM = 0.12  # silicone reproduces every layer


def pin_name(pin: Pin) -> str:
    """Return the name of a pin's kind, which states its diameter and length in mm."""
    return f"pin-{pin.diameter:g}x{pin.length:.1f}"


def pin_kinds(part_set: PartSet) -> dict[str, tuple[Surface, int, dict[str, float]]]:
    """Return every kind of loose pin.

    Args:
        part_set: The parts of a device.

    Returns:
        For each name of a kind: its surface, how many a device needs, and its sizes in mm.
    """
    kinds: dict[str, tuple[Surface, int, dict[str, float]]] = {}
    for pin in part_set.pins:
        name = pin_name(pin)
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


def measure_part_supports(part_set: PartSet) -> dict[str, Overhang]:
    """Return the overhangs of the parts that need supports as they are printed, by name.

    Grooves, pockets and sockets need none. A part without a flat face to stand on needs supports,
    even if none of its overhangs does.
    """
    overhangs = {}
    for index, (part, bare) in enumerate(zip(part_set.parts, part_set.bare, strict=True)):
        overhang = measure_overhang(bare, part.down, part_set.cut_planes(index))
        solid = triangle_kernel.to_manifold(part.surface, part.name)
        if overhang.area or first_layer_area(solid, part.down) < MIN_FIRST_LAYER_MM2:
            overhangs[part.name] = overhang
    return overhangs


def measure_piece_supports(lying: Mapping[str, Surface]) -> dict[str, Overhang]:
    """Return the overhangs of the pieces of moulds that need supports, by name.

    Args:
        lying: Surfaces in print orientation, by name.
    """
    down = np.array([0.0, 0.0, -1.0])
    overhangs = {
        name: measure_overhang(triangle_kernel.to_manifold(surface, name), down)
        for name, surface in lying.items()
    }
    return {name: overhang for name, overhang in overhangs.items() if overhang.area}


def lying_notes(part_set: PartSet) -> dict[str, Float | None]:
    """Return a note for each part that lies on its skin to save supports, with its middle (3,)."""
    notes: dict[str, Float | None] = {}
    for index, (part, bare) in enumerate(zip(part_set.parts, part_set.bare, strict=True)):
        faces = part_set.cut_planes(index)
        if faces and not any(part.down @ face > MIN_SAME_SIDE_COSINE for face, _ in faces):
            saved = measure_overhang(bare, faces[0][0], faces)
            if saved.volume > measure_overhang(bare, part.down).volume:
                text = (
                    f"{part.name} is printed on its skin: on its cut face {saved.area:.0f} mm2 of"
                    f" {saved.face.replace('cut', 'another cut')} would need supports"
                )
                notes[text] = part.center
    return notes


def print_advice(device: Device, supports: Mapping[str, Overhang]) -> list[str]:
    """Return advice on how to print a device's parts or moulds, the most important first.

    Args:
        device: The device.
        supports: Overhangs of the parts, or of the pieces of moulds, that need supports, by name.

    Returns:
        Sentences for the assembler.
    """
    fabrication = device.fabrication
    if fabrication.kind == "cast":
        return _advise_on_moulds(device, supports)
    feedstock = _FEEDSTOCKS.get(fabrication.process.split("-")[0])
    advice = [
        "Print every part in the orientation in which it lies on its plate, on its cut face unless"
        " a note names another side. Grooves need no supports."
    ]
    if supports and feedstock not in ("jets", "powder"):
        places = "skin"
        if any("cut" in overhang.face for overhang in supports.values()):
            places = "faces that are named"
        advice.append(
            f"Print {_list_overhangs(supports)} with supports on the {places}, none in grooves,"
            " pockets and sockets: block them there, as their remains narrow the channels."
        )
    if feedstock == "filament":
        advice += _advise_on_filament(device, bool(supports))
    elif feedstock == "jets":
        advice += [
            "Choose the matte finish. A glossy finish puts support on some sides only, which makes"
            " the grooves unequal.",
            "Support fills grooves, pockets and sockets. Wash it out with a water jet, and push a"
            " rod of the cord's diameter through every groove before you close any joint.",
        ]
    elif feedstock == "resin":
        advice += [
            "Print the parts flat on the plate if your printer can. If you must tilt them, put"
            " supports on the skin only, not in grooves, pockets and sockets.",
            "Wash grooves and sockets with a syringe, and blow them out before you cure the parts:"
            " resin that stays in them cures there.",
        ]
    elif feedstock == "powder":
        advice += [
            "The orientation does not matter. Ask the service to blow the powder out of grooves,"
            " pockets and sockets, and not to infiltrate or vapour-smooth the parts: that changes"
            " their stiffness and the channels.",
        ]
    channel = device.channel_diameter
    if fabrication.hole > channel:
        advice.append(
            f"The channels of {channel:.1f} mm are narrower than the smallest hole of this process,"
            f" {fabrication.hole:g} mm. Clear each of them while it is still an open groove."
        )
    return advice


def _list_overhangs(supports: Mapping[str, Overhang]) -> str:
    """Return the names of parts that need supports, with the size of their overhangs."""
    return ", ".join(
        f"{name} ({overhang.area:.0f} mm2 of overhang{_name_cut_face(overhang)}, up to"
        f" {overhang.height:.0f} mm high)"
        if overhang.area
        else f"{name} (no flat face to stand on)"
        for name, overhang in supports.items()
    )


def _name_cut_face(overhang: Overhang) -> str:
    """Return the faces of an overhang with a preposition; empty if it is all skin."""
    return "" if overhang.face == "skin" else f" of its {overhang.face}"


def _advise_on_filament(device: Device, has_supports: bool) -> list[str]:
    fabrication = device.fabrication
    wall_lines = round(fabrication.wall / fabrication.line)
    advice = [
        f"Use {wall_lines} wall lines of {fabrication.line:g} mm, layers of"
        f" {fabrication.layer:g} mm and 100 % infill: the prediction assumes solid parts.",
        "Switch off supports for all other parts."
        if has_supports
        else "No part needs supports. Switch them off, also painted and automatic ones in grooves"
        " and sockets: their remains narrow the channels.",
        f"Dry the filament. Print {describe_speed(fabrication)}, and avoid travel across grooves if"
        " the slicer can: strings in a groove hold the cord.",
    ]
    if "bowden" in fabrication.process:
        advice.append(
            "A Bowden extruder leaves more strings: retract 3 to 5 mm slowly, and clear the grooves"
            " with a wire of the channel's diameter."
        )
    return advice


def _advise_on_moulds(device: Device, supports: Mapping[str, Overhang]) -> list[str]:
    fabrication = device.fabrication
    is_resin = fabrication.process.endswith("resin")
    plastic = "resin" if is_resin else "plastic such as PLA or PETG"
    advice = [
        "Print every piece of the moulds in the orientation in which it lies on its plate, with"
        f" cores and cavities up, in a rigid {plastic}."
        + (
            f" Print {_list_overhangs(supports)} with supports, and no other piece."
            if supports
            else " No piece needs supports."
        ),
    ]
    if is_resin:
        advice.append(
            "Wash and cure the moulds completely, then make sure that they are sealed: platinum"
            " silicone stays sticky on uncured resin. Use three coats of clear acrylic lacquer, or"
            " a day at 60 degrees after curing. Try a spoonful of silicone on a scrap first."
        )
    else:
        lines = max(3, round(_MIN_MOULD_SHELL_MM / fabrication.line))
        layer = min(fabrication.layer, _MAX_MOULD_LAYER_MM)
        advice.append(
            f"Use {lines} wall lines of {fabrication.line:g} mm, layers of {layer:g} mm and 20 %"
            " infill: silicone reproduces every layer, and leaks through thin walls."
        )
    advice.append(
        "Print the pins with the moulds, in the same rigid plastic: they only align the parts."
        " Leave out pins that would be felt."
    )
    return advice
