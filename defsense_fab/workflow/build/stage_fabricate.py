"""Stage 5: make the printable parts, the plates, the assembly and the cut list."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.mesh import Surface
from ...core.progress import subrange
from ...geometry.moulds.moulds import make_moulds
from ...geometry.moulds.records import Mould
from ...geometry.parts.channel_openings import MIN_CROSSING_ANGLE_RAD
from ...geometry.parts.parts import add_solids
from ...geometry.parts.records import PartSet
from ...geometry.printing.export import write_3mf, write_stl
from ...geometry.printing.overhangs import Overhang
from ...geometry.printing.print_bed import lay_flat
from ...geometry.splitting.long_parts import split_long_parts
from ...optimization.prediction.as_built import (
    decide_strain_relief,
    fabricate,
    mould_rules,
    part_rules,
    score_channels,
)
from ...optimization.prediction.assembly_effects import check_cord_pull, find_overstretched_cords
from ...optimization.prediction.design_task import load_task
from ...optimization.prediction.predict import ScoredLayout
from ...store.build import Build
from ...store.layout import LayoutRecord, Prediction
from ...store.manifest import (
    CutCord,
    GluelessSpot,
    JoinedPin,
    JoinStep,
    Manifest,
    PartRecord,
    Socket,
    TagSeat,
    save_manifest,
)
from ..fabrication import casting, printed
from ..fabrication.printing import (
    LYING,
    lying_notes,
    measure_part_supports,
    measure_piece_supports,
    on_plates,
    pin_kinds,
    pin_name,
    print_advice,
    write_pins,
    write_plates,
)
from .cut_list import behind, bill, cut_list
from .stage_optimize import Winner, require_feasible_layout
from .stages import Report

_GLUE_MARGIN_MM = 2.0  # next to a channel, which a hand with a glue bottle can keep free

#: Assumed response of bonded cords to compression, by `[cord] compression`.
COMPRESSION_RESPONSES = {
    "same": "the same as in tension",
    "half": "half of that in tension",
    "none": "none",
    "rising": "the reverse of that in tension, so that resistance rises both ways",
}
# Stiffness of a cord, relative to the body in its place, above which there is a warning.
_MAX_STIFFNESS_RATIO = 2.0


def run(device: Device, build: Build, report: Report, winner: Winner | None = None) -> None:
    """Make the parts, and save them with their manifest.

    Args:
        device: The device.
        build: Results of the earlier stages.
        report: Receives the completed fraction and a message.
        winner: Parts of the layout from the stage before, if it was run in this process.

    Raises:
        FabricationError: A cord or a part fails a check, or no layout can be made.
    """
    layout = build.layout
    require_feasible_layout(device, layout)
    if winner is None:
        winner = _make_layout(device, build, report)
    report(0.6, "cutting the solid")
    device, parts = winner.device, winner.parts
    if build.solid is not None and device.cord.trace is None:
        parts = add_solids(parts, build.solid)
    report(0.75, "predicting with joints")
    built = score_channels(winner.task, parts.channels)
    middles = layout.middles
    notes = (
        *find_overstretched_cords(device, parts, built.cords),
        *check_cord_pull(device, winner.task, built.cords, layout.band.median),
    )
    parts = parts.with_warnings(
        dict.fromkeys(winner.notes) | {str(note): middles.get(note.where) for note in notes}
    )
    cords = cut_list(device, parts, built)
    show = subrange(report, 0.8, 1.0)
    if device.cord.trace is None:
        build.manifest = write_parts(
            device, parts, build.folder, layout, cords, built.prediction, show
        )
    else:
        build.manifest = _write_printed(device, parts, build.folder, layout, cords, built)


def _make_layout(device: Device, build: Build, report: Report) -> Winner:
    """Make the parts of the layout that an earlier process saved."""
    sensors = [s.sensor() for s in build.layout.sensors]
    task = load_task(device, build).with_decoder(build.layout.prediction.decoder)
    surface, bay = build.surface, build.body.bay
    device, channels, notes = decide_strain_relief(device, task, surface, sensors, bay)
    parts = fabricate(device, surface, sensors, report, None, bay, channels)
    return Winner(device, notes, parts, task)


def _write_printed(
    device: Device,
    parts: PartSet,
    folder: Path,
    layout: LayoutRecord,
    rows: tuple[CutCord, ...],
    built: ScoredLayout,
) -> Manifest:
    """Write a body with printed traces into the folder `parts`, and return the saved manifest."""
    out = folder / "parts"
    out.mkdir()
    plates, _ = printed.write_printed(device, parts, out)
    _write_surfaces(device, parts, None, out)
    records = printed.trace_records(device, parts, built, rows)
    parts = parts.with_warnings(printed.printing_notes(device, records))
    manifest = replace(
        _manifest(device, parts, {}, layout, rows, built.prediction, {}),
        plates=plates,
        traces=records,
        advice=tuple(printed.printing_advice(device)),
        copies=device.fabrication.copies,
    )
    save_manifest(folder, manifest)
    return manifest


def write_parts(
    device: Device,
    parts: PartSet,
    folder: Path,
    layout: LayoutRecord,
    cords: tuple[CutCord, ...],
    prediction: Prediction,
    report: Report = lambda *_: None,
) -> Manifest:
    """Write the parts into the folder `parts` of a build.

    Args:
        device: The device.
        parts: The parts.
        folder: The build's folder.
        layout: The layout.
        cords: The cut list, for the parts before long ones are split.
        prediction: The errors predicted for the cords as they are built in.
        report: Receives the completed fraction and a message.

    Returns:
        The manifest, which is also saved.
    """
    is_cast = device.fabrication.kind == "cast"
    moulds = []
    if is_cast:
        moulds = make_moulds(parts, mould_rules(device), subrange(report, 0, 0.9))
    else:
        cut_count = len(parts.cuts)
        parts = split_long_parts(parts, device.fabrication.bed, part_rules(device))
        cords = behind(cords, len(parts.cuts) - cut_count)  # pieces are joined first
    report(0.9 if is_cast else 0.0, "writing parts")
    if is_cast:
        flat = casting.lying(moulds)
    else:
        flat = {p.name: lay_flat(p.surface, p.down) for p in parts.parts}
    pins = pin_kinds(parts)
    placed, min_plates = on_plates(device, flat, pins)
    if is_cast:
        supports = measure_piece_supports(flat)
    else:
        supports = measure_part_supports(parts)
        parts = parts.with_warnings(lying_notes(parts))
    out = folder / "parts"
    out.mkdir()
    (out / LYING).mkdir()
    _write_surfaces(device, parts, None if is_cast else flat, out)
    manifest = replace(
        _manifest(device, parts, pins, layout, cords, prediction, supports),
        pins=write_pins(pins, out),
        plates=write_plates(placed, out, device.name),
        advice=tuple(print_advice(device, supports)),
        copies=device.fabrication.copies,
        least_plates=min_plates,
    )
    if is_cast:
        manifest = _add_casting(device, manifest, moulds, flat, out)
    save_manifest(folder, manifest)
    return manifest


def _write_surfaces(
    device: Device, parts: PartSet, flat: Mapping[str, Surface] | None, out: Path
) -> None:
    """Write the parts in their places and, if `flat` is given, as they lie on the printer's bed."""
    for part in parts.parts:
        write_stl(part.surface, out / f"{part.name}.stl")
        if flat is not None:
            write_stl(flat[part.name], out / LYING / f"{part.name}.stl")
    solids = {p.name: p.solid for p in parts.parts if p.solid is not None}
    if solids:
        from ...geometry.kernels import occ

        for name, solid in solids.items():
            occ.write_step(solid, out / f"{name}.step", name)
        occ.write_assembly(solids, out / "assembly.step", device.name)
    write_3mf({p.name: p.surface for p in parts.parts}, out / "assembly.3mf", device.name)


def _add_casting(
    device: Device,
    manifest: Manifest,
    moulds: Sequence[Mould],
    flat: dict[str, Surface],
    out: Path,
) -> Manifest:
    """Write the moulds, and return the manifest with them and their silicone."""
    silicone = casting.casting(device, moulds)
    notes = casting.notes(device, moulds)
    return replace(
        manifest,
        moulds=casting.write_moulds(moulds, flat, out, LYING),
        casting=silicone,
        bill=(*casting.bill_items(device, moulds, silicone), *manifest.bill[1:]),
        checks=(*manifest.checks, *(c for m in moulds for c in m.checks)),
        warnings=(*manifest.warnings, *notes),
        places={**manifest.places, **{t: p for t, p in notes.items() if p is not None}},
    )


def _manifest(
    device: Device,
    parts: PartSet,
    pins: Mapping[str, tuple[Surface, int, Mapping[str, float]]],
    layout: LayoutRecord,
    cords: tuple[CutCord, ...],
    prediction: Prediction,
    supports: Mapping[str, Overhang],
) -> Manifest:
    parts = parts.with_warnings(
        cord_warnings(device, layout) | _length_warnings(device, cords, layout.middles)
    )
    return Manifest(
        device=device.name,
        unit="mm",
        parts=tuple(
            _part(parts, i, device.fabrication.kind == "cast" or bool(parts.traces), supports)
            for i in range(len(parts.parts))
        ),
        pins=(),
        plates=(),
        cords=cords,
        bill=bill(device, parts, cords, {n: count for n, (_, count, _) in pins.items()}),
        assembly=join_steps(parts),
        marker_seats=tuple(
            TagSeat(s.number, s.center, s.axes[:, 0], s.axes[:, 2], device.fabrication.marker_size)
            for s in parts.seats
        ),
        checks=parts.checks,
        prediction=prediction,
        removed_volume=parts.cut_out,
        body_volume=parts.body_volume,
        assembly_of_cords=device.fabrication.assembly,
        warnings=tuple(parts.warnings),
        places={text: point for text, point in parts.warnings.items() if point is not None},
    )


def _length_warnings(
    device: Device, cords: Sequence[CutCord], middles: Mapping[str, Float]
) -> dict[str, Float | None]:
    """Return warnings of cords that need a longer piece than is available, with their middles."""
    longest = device.cord.lengths[1]
    return {
        f"cord {c.sensor} needs a piece of {c.cut_length:.0f} mm, more than the {longest:g} mm of"
        " [cord] length: "
        + (
            "an end has no pocket and hangs out. Use a longer piece, or a shorter"
            " [fabrication] lead"
            if all(e.after is None for e in c.ends)
            else "an end hangs out until a joint that it passes through is closed. Use a longer"
            " piece"
        ): middles.get(c.sensor)
        for c in cords
        if c.cut_length > longest
    }


def cord_warnings(device: Device, layout: LayoutRecord) -> dict[str, Float | None]:
    """Return warnings about the strains of the cords as they are built in.

    Args:
        device: The device.
        layout: The layout.

    Returns:
        The middle (3,) mm of the cord that each warning is about, by its text; None for all cords.
    """
    middles = layout.middles
    cord, bonded = device.cord, device.fabrication.assembly == "bonded"
    warnings: dict[str, Float | None] = {
        f"{cord.noun} {s.name!r} is stretched by {s.peak_strain:.0%}, more than the allowed"
        f" {cord.max_strain:.0%}": middles[s.name]
        for s in layout.sensors
        if s.peak_strain > cord.max_strain
    }
    warnings |= {
        f"cord {s.name} is slack by {-s.least_strain:.1%} where the body is compressed most along"
        " it, and does not sense that."
        " Remove prestretch from [fabrication], or increase it": middles[s.name]
        for s in layout.sensors
        if not bonded and s.least_strain < 0
    }
    is_compressed = any(s.least_strain < 0 for s in layout.sensors)
    if bonded and is_compressed and cord.compression != "measured" and cord.trace is None:
        text = (
            "bonded cords are compressed, and their response to compression was not measured; it"
            f" is assumed to be {COMPRESSION_RESPONSES[cord.compression]}. Calibrate the cord, or"
            ' use assembly = "held", which stretches cords so far that none is compressed'
        )
        warnings[text] = None
    if cord.trace is not None:
        return warnings  # `printing_notes` has what concerns traces
    body_stiffness = device.material.young_modulus * device.channel_diameter**2
    if bonded and cord.modulus * cord.diameter**2 > _MAX_STIFFNESS_RATIO * body_stiffness:
        text = (
            f"the cord ({cord.modulus:g} MPa) is stiffer than {device.material.name}"
            f" ({device.material.young_modulus:.2g} MPa), which the simulation ignores. Bonded"
            " cords are strained some per cent less than predicted; training corrects for that"
        )
        warnings[text] = None
    return warnings


def _part(parts: PartSet, i: int, cast: bool, supports: Mapping[str, Overhang]) -> PartRecord:
    part = parts.parts[i]
    step, volume = None, None
    if part.solid is not None:
        from ...geometry.kernels import occ

        step, volume = f"{part.name}.step", occ.volume(part.solid)
    return PartRecord(
        name=part.name,
        number=i + 1,
        stl=f"{part.name}.stl",
        print=f"{part.name}.stl" if cast else f"{LYING}/{part.name}.stl",
        step=step,
        volume=part.volume,
        bbox=part.surface.bounds,
        sockets=tuple(
            Socket(p.center, p.axis, p.socket)
            for p in parts.pins
            if i in (parts.contacts[p.contact].lower, parts.contacts[p.contact].upper)
        ),
        step_volume=volume,
        support_area=supports[part.name].area if part.name in supports else 0.0,
    )


def _glueless_spots(parts: PartSet, cut: int) -> list[GluelessSpot]:
    """Return the spots of the faces of a cut where glue would flow into a channel, or onto a wire
    that is pulled while the joint closes.
    """
    pockets = parts.rules.pockets
    wire = pockets.wires.diameter if pockets and pockets.wires else 0.0
    lines = [(c.name, c.inside, parts.rules.channel) for c in parts.channels]
    lines += [(c.name, lead.inside, wire) for c in parts.channels for lead in c.leads]
    contacts = [c for c in parts.contacts if c.cut == cut]
    spots = []
    for opening in (o for o in parts.openings if o.cut == cut):
        reach = max(opening.reach, _GLUE_MARGIN_MM)
        # Other joints can be in the same plane.
        if any(c.is_near(opening.at, reach) for c in contacts):
            spots.append(GluelessSpot(parts.channels[opening.line].name, opening.at, reach))
    for contact in contacts:
        for name, line, diameter in lines:
            for at, sine in contact.crossings(line, diameter):
                reach = (diameter / 2 + _GLUE_MARGIN_MM) / max(sine, np.sin(MIN_CROSSING_ANGLE_RAD))
                _add_crossing(spots, GluelessSpot(name, at, reach, is_crossing=True), diameter / 2)
    return spots


def _add_crossing(spots: list[GluelessSpot], crossing: GluelessSpot, radius: float) -> None:
    """Add the spot of a crossing, or extend the open stretch of the same cord that it is in.

    Faces next to each other both have a crossing at their border, which is added once.
    """
    for k, spot in enumerate(spots):
        apart = float(np.linalg.norm(spot.at - crossing.at))
        if spot.cord != crossing.cord or apart > (radius if spot.is_crossing else spot.reach):
            continue
        if not spot.is_crossing:
            spots[k] = replace(spot, reach=max(spot.reach, apart + crossing.reach))
        return
    spots.append(crossing)


def join_steps(parts: PartSet) -> tuple[JoinStep, ...]:
    """Return the steps that close the device, which are the cuts in reverse order."""
    steps = []
    for k in reversed(range(len(parts.cuts))):
        cut = parts.cuts[k]
        low, high = (tuple(parts.parts[i].name for i in side) for side in cut.sides)
        steps.append(
            JoinStep(
                join=(low, high),
                cords=tuple(parts.channels[c].name for c in cut.cords if c not in cut.wires),
                wires=tuple(parts.channels[c].name for c in cut.wires),
                opens=cut.plane.normal,
                pins=tuple(
                    JoinedPin(
                        name=pin_name(p),
                        center=p.center,
                        socket=p.socket,
                        depth=p.depth,
                        between=(
                            parts.parts[parts.contacts[p.contact].lower].name,
                            parts.parts[parts.contacts[p.contact].upper].name,
                        ),
                    )
                    for p in parts.pins
                    if parts.contacts[p.contact].cut == k
                ),
                glueless=tuple(_glueless_spots(parts, k)),
            )
        )
    return tuple(steps)
