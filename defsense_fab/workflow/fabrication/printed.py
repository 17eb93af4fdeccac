"""Write a body with printed traces for slicers, and advise on how to print it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device, FabricationSpec
from ...core.device.filaments import read_filaments
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...geometry.kernels.cutting_tools import axes_from_normal
from ...geometry.parts.records import PartSet
from ...geometry.printing.export import write_stl
from ...geometry.printing.print_bed import fits_bed
from ...geometry.printing.slicer_files import (
    ColoredSolid,
    write_bambu_3mf,
    write_material_3mf,
    write_prusa_3mf,
)
from ...geometry.printing.slicer_settings import (
    TraceSettings,
    format_prusa_settings,
    write_prusa_settings,
)
from ...optimization.prediction.predict import ScoredLayout
from ...sensing.built_cord import CordReading
from ...store.manifest import CutCord, Plate, TraceRecord
from .print_time import describe_speed

PRUSA_3MF, BAMBU_3MF, MATERIAL_3MF = "prusaslicer.3mf", "bambu-orca.3mf", "materials.3mf"
SETTINGS = "two-extruders.ini"
_MAX_WARMING_K = 1.0  # by the read-out: no temperature coefficient of a trace is known
_SUPPLY_V = 5.0  # of the boards in firmware/, across a trace and a reference resistor as large
#: Thermal conductivity of TPU, W/(m K): the table of polymers of NETZSCH
#: (polymers.netzsch.com/Materials/Details/48).
_CONDUCTIVITY = 0.19
#: Heat that leaves the skin by radiation, W/(m^2 K): 4 sigma T^3 at 293 K for an emissivity of 0.9,
#: which is assumed. Convection would about double it.
_RADIATION = 4 * 0.9 * 5.67e-8 * 293**3
_LARGEST_READABLE_OHM = 1e6


def place_on_bed(points: Float, up: Float, body: Surface, bed: tuple[float, float, float]) -> Float:
    """Return points of a device where they are in the files for slicers.

    Args:
        points: Points (n, 3), mm, rest frame.
        up: Unit direction (3,) that points up as the body is printed.
        body: Surface of the body, rest frame.
        bed: Size of the bed, mm.

    Returns:
        Points (n, 3), mm: the body stands in the middle of the bed.
    """
    axes = axes_from_normal(up)
    corners = body.vertices @ axes
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = np.append((low + high)[:2] / 2 - np.array(bed[:2]) / 2, low[2])
    return np.asarray(points @ axes - middle)


def write_printed(
    device: Device, parts: PartSet, out: Path
) -> tuple[tuple[Plate, ...], tuple[str, ...]]:
    """Write the files of a body with traces into the folder of the parts.

    Args:
        device: The device.
        parts: The body and its traces.
        out: Folder of the parts.

    Returns:
        Records of the files to print, and names of all 3MF files.

    Raises:
        FabricationError: The bed does not hold the body.
    """
    up, bed = np.array(device.fabrication.up), device.fabrication.bed
    body = parts.parts[0].surface

    def lie(surface: Surface) -> Surface:
        return Surface(place_on_bed(surface.vertices, up, body, bed), surface.faces)

    whole = lie(body)
    centered = Surface(whole.vertices - np.append(np.array(bed[:2]) / 2, 0.0), whole.faces)
    if not fits_bed(centered, bed):
        x, y, z = np.ptp(whole.bounds, axis=0)
        raise FabricationError(
            f"measures {x:.0f} x {y:.0f} x {z:.0f} mm as it is printed and does not fit the bed of"
            f" {bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm",
            code="part-too-large",
            where=parts.parts[0].name,
            action="Change [fabrication] up or bed, or make the body smaller",
            part=parts.parts[0].name,
            size=(float(x), float(y), float(z)),
        )
    solids = [ColoredSolid("body", whole, 1)]
    for trace in parts.traces:
        write_stl(trace.surface, out / f"{trace.name}.stl")
        solids.append(ColoredSolid(trace.name, lie(trace.surface), 2, is_trace=True))
    files = write_slicer_files(solids, device.fabrication, out, device.name)
    plate = Plate(PRUSA_3MF, {s.name: s.surface.bounds for s in solids})
    return (plate,), files


def write_slicer_files(
    solids: Sequence[ColoredSolid], fabrication: FabricationSpec, out: Path, title: str
) -> tuple[str, ...]:
    """Write one object of several solids as 3MF files, and settings for PrusaSlicer.

    Args:
        solids: The solids, where they are on the bed.
        fabrication: Printer with two extruders.
        out: Folder of the files.
        title: Name of the object.

    Returns:
        Names of the 3MF files.
    """
    f = fabrication
    settings = TraceSettings(
        nozzle_mm=(f.line, f.line), layer_mm=f.layer, bed_mm=(f.bed[0], f.bed[1])
    )
    write_prusa_settings(settings, out / SETTINGS)
    write_prusa_3mf(solids, out / PRUSA_3MF, title, format_prusa_settings(settings))
    write_bambu_3mf(solids, out / BAMBU_3MF, title)
    write_material_3mf(solids, out / MATERIAL_3MF, title)
    return PRUSA_3MF, BAMBU_3MF, MATERIAL_3MF


def trace_records(
    device: Device, parts: PartSet, built: ScoredLayout, rows: tuple[CutCord, ...]
) -> tuple[TraceRecord, ...]:
    """Return the records of the traces, in the order of their channels.

    Args:
        device: The device.
        parts: The body and its traces.
        built: What the traces sense.
        rows: Their resistances, as rows of a cut list.
    """
    spec = device.cord.trace
    assert spec is not None
    return tuple(
        TraceRecord(
            name=trace.name,
            stl=f"{trace.name}.stl",
            line=channel.inside,
            pads=np.round([end.mouth for end in channel.ends], 4) + 0.0,  # no negative zeros
            volume=trace.volume,
            length=channel.length,
            resistance=row.resistance,
            range=row.range,
            reference_resistor=row.reference_resistor,
        )
        for trace, channel, row, _ in zip(
            parts.traces, parts.channels, rows, built.cords, strict=True
        )
    )


def printing_advice(device: Device) -> list[str]:
    """Return advice on how to print a body with traces, the most important first."""
    spec, pad, f = device.cord.trace, device.pad, device.fabrication
    assert spec is not None
    assert pad is not None
    lines = max(2, round(spec.width / f.line))
    return [
        f"Open {PRUSA_3MF} in PrusaSlicer or SuperSlicer, {BAMBU_3MF} in Bambu Studio or"
        f" OrcaSlicer, and {MATERIAL_3MF} in others. Extruder 1 prints the body in"
        f" {device.material.name}, extruder 2 the traces in {spec.filament}. Only PrusaSlicer 2.5"
        " was used to check these files.",
        f"Keep the orientation of the file. Use layers of {f.layer:g} mm and 100 % infill in the"
        f" body, and {lines} wall lines without infill in the traces: beads along a trace conduct"
        f" about {spec.across:g} times better than across it.",
        "Purge well after each change of filament, into a tower, not into the infill: a little"
        " conductive filament in the body may join two traces.",
        f"Dry both filaments. Print {describe_speed(f)}, with the same temperature for both if they"
        " allow it, so that they weld.",
        f"Run 'defsense traces {device.name} FILE.gcode' before you print: it finds gaps, thin"
        " places and contacts between traces, and the resistance to expect.",
        f"Each trace ends in two pads of {pad.diameter:g} mm on the skin, for the {pad.name} that"
        " [wires] pad states. Solder does not stick to them.",
    ]


def trace_warming(device: Device, record: TraceRecord) -> float:
    """Return the temperature (K) above the surroundings that the read-out keeps a trace at.

    The estimate is an upper one: half of the supply is across the trace all the time, heat leaves
    through the thinnest wall all around as if there were no body beyond it, and the skin loses it
    by radiation alone. The trace counts where it conducts worst.

    Args:
        device: A device with printed traces.
        record: The trace.
    """
    spec = device.cord.trace
    assert spec is not None
    section = CordReading.from_device(device).section
    assert section is not None
    current = _SUPPLY_V / 2 / record.resistance
    steepest = float(section.relative_resistance(record.line).max())
    power = 1e3 * current**2 * device.cord.ohm_per_mm * steepest  # W per m
    inner = (spec.area / np.pi) ** 0.5
    outer = inner + device.fabrication.wall
    resistance = np.log(outer / inner) / _CONDUCTIVITY + 1e3 / (outer * _RADIATION)  # 2 pi m K / W
    return float(power * resistance / (2 * np.pi))


def printing_notes(device: Device, records: tuple[TraceRecord, ...]) -> dict[str, Float | None]:
    """Return what a maker should know about the traces, each with a place (3,) mm, if it has one.

    Args:
        device: The device.
        records: The traces.
    """
    spec = device.cord.trace
    assert spec is not None
    notes: dict[str, Float | None] = {}
    assumed = sorted(
        name
        for name, quantity in read_filaments().get(spec.filament, {}).items()
        if quantity.basis == "assumed"
    )
    if assumed:
        notes[
            f"{', '.join(assumed)} of {spec.filament} are assumed, not measured. Print the traces"
            " once, measure their resistance, and state what you found in [cord]"
        ] = None
    for record in records:
        middle = record.line[len(record.line) // 2]
        warming = trace_warming(device, record)
        if warming > _MAX_WARMING_K:
            notes[
                f"the read-out warms trace {record.name} by up to {warming:.1f} K, which changes"
                " its resistance. Supply the divider only while it is read, or use a thinner trace"
            ] = middle
        if record.resistance > _LARGEST_READABLE_OHM:
            notes[
                f"trace {record.name} has about {record.resistance / 1e6:.1f} Mohm, too much for a"
                " plain divider: readings are noisy. Use a wider trace or a better filament"
            ] = middle
    return notes
