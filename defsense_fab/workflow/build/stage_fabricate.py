"""Stage 5: printable parts, the plates, the assembly, the cut list."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from ...core.device.device import Device
from ...core.mesh import Surface
from ...core.prediction import Prediction
from ...geometry.moulds.moulds import make_moulds
from ...geometry.parts.parts import add_solids
from ...geometry.parts.records import PartSet
from ...geometry.printing.export import write_3mf, write_stl
from ...geometry.printing.print_bed import lay_flat
from ...geometry.splitting.long_parts import split_long_parts
from ...optimize.prediction.as_built import score_channels, fabricate, mould_rules, part_rules, decide_strain_relief
from ...optimize.prediction.assembly_effects import check_cord_pull
from ...optimize.prediction.design_task import load_task
from ...optimize.prediction.assembly_effects import find_overstretched_cords
from ...optimize.refinement.refine import report_part
from ...store.build import Build
from ...store.layout import LayoutRecord
from ...store.manifest import (
    CutCord,
    JoinedPin,
    JoinStep,
    Manifest,
    PartRecord,
    Socket,
    TagSeat,
    save_manifest,
)
from ..fabrication import casting
from ..fabrication.plates import LYING, on_plates, pin_kinds, write_pins, write_plates
from ..fabrication.print_advice import print_advice
from .cut_list import behind, bill, cut_list
from .stage_optimize import Winner
from .stages import Report

#: What bonded cords are taken to answer to compression, by `[cord] compression`.
ANSWERS = {
    "same": "the same as in tension",
    "half": "half of that in tension",
    "none": "none",
    "rising": "the reverse of that in tension, so that resistance rises both ways",
}
#: Cords that are so many times as stiff as the body in their place are told.
_STIFF = 2.0


def run(device: Device, build: Build, report: Report, winner: Winner | None = None) -> None:
    """Make the parts, and save them with their manifest.

    Args:
        device: The device.
        build: Results of the earlier stages.
        report: Receives the completed fraction and a message.
        winner: Parts of the layout from the stage before, if it was run in this process.

    Raises:
        FabricationError: A cord or a part fails a check.
    """
    layout = build.layout
    if winner is None:
        winner = _make_layout(device, build, report)
    report(0.6, "cutting the solid")
    parts = winner.parts if build.solid is None else add_solids(winner.parts, build.solid)
    device = winner.device
    report(0.75, "predicting with joints")
    built = score_channels(winner.task, parts.channels)
    warnings = (
        *parts.warnings,
        *winner.notes,
        *map(str, find_overstretched_cords(device, parts, built.cords)),
        *map(str, check_cord_pull(device, winner.task, built.cords, layout.band.median)),
    )
    parts = replace(parts, warnings=warnings)
    cords = cut_list(device, parts, built)
    show = partial(report_part, report, 0.8, 1.0)
    build.manifest = write_parts(device, parts, build.folder, layout, cords, built.prediction, show)


def _make_layout(device: Device, build: Build, report: Report) -> Winner:
    """Make the parts of the saved layout again."""
    sensors = [s.sensor() for s in build.layout.sensors]
    task = load_task(device, build).with_decoder(build.layout.prediction.decoder)
    surface, bay = build.surface, build.body.bay
    device, notes = decide_strain_relief(device, task, surface, sensors, bay)
    return Winner(
        device, tuple(notes), fabricate(device, surface, sensors, report, None, bay), task
    )


def write_parts(
    device: Device,
    made: PartSet,
    folder: Path,
    layout: LayoutRecord,
    cords: tuple[CutCord, ...],
    prediction: Prediction,
    report: Report = lambda *_: None,
) -> Manifest:
    """Write the parts into the folder `parts` of a build.

    Args:
        device: The device.
        made: The parts.
        folder: The build's folder.
        layout: The layout.
        cords: The cut list, for the parts before long ones are split.
        prediction: The errors predicted for the cords as they are built in.
        report: Receives the completed fraction and a message.

    Returns:
        The manifest, which is also saved.
    """
    cast = device.fabrication.kind == "cast"
    if not cast:
        split = split_long_parts(made, device.fabrication.bed, part_rules(device))
        cords = behind(cords, len(split.made.cuts) - len(made.cuts))  # pieces are joined first
        made = replace(split.made, warnings=(*split.made.warnings, *split.notes))
    moulds = (
        make_moulds(made, mould_rules(device), partial(report_part, report, 0, 0.9)) if cast else []
    )
    report(0.9 if cast else 0.0, "writing parts")
    flat = casting.lying(moulds) if cast else {p.name: lay_flat(p.surface, p.down) for p in made.parts}
    pins = pin_kinds(made)
    placed, bound = on_plates(device, flat, pins)
    out = folder / "parts"
    out.mkdir()
    (out / LYING).mkdir()
    for one in made.parts:
        write_stl(one.surface, out / f"{one.name}.stl")
        if not cast:
            write_stl(flat[one.name], out / LYING / f"{one.name}.stl")
    solids = {p.name: p.solid for p in made.parts if p.solid is not None}
    if solids:
        from ...geometry.kernels import occ

        for name, solid in solids.items():
            occ.write_step(solid, out / f"{name}.step", name)
        occ.write_assembly(solids, out / "assembly.step", device.name)
    write_3mf({p.name: p.surface for p in made.parts}, out / "assembly.3mf", device.name)
    manifest = _manifest(device, made, pins, layout, cords, prediction)
    manifest = replace(
        manifest,
        pins=write_pins(pins, out),
        plates=write_plates(placed, out, device.name),
        advice=tuple(print_advice(device)),
        copies=device.fabrication.copies,
        least_plates=bound,
    )
    if cast:
        silicone = casting.casting(device, moulds)
        manifest = replace(
            manifest,
            moulds=casting.write_moulds(moulds, flat, out, LYING),
            casting=silicone,
            bill=(*casting.bill_items(device, moulds, silicone), *manifest.bill[1:]),
            checks=(*manifest.checks, *(c for m in moulds for c in m.checks)),
            warnings=(
                *manifest.warnings,
                *casting.notes(device, moulds),
                *(c.note for m in moulds for c in m.checks if c.note),
            ),
        )
    save_manifest(folder, manifest)
    return manifest


def _manifest(
    device: Device,
    made: PartSet,
    pins: Mapping[str, tuple[Surface, int, Mapping[str, float]]],
    layout: LayoutRecord,
    cords: tuple[CutCord, ...],
    prediction: Prediction,
) -> Manifest:
    return Manifest(
        device=device.name,
        unit="mm",
        parts=tuple(
            _part(made, i, device.fabrication.kind == "cast") for i in range(len(made.parts))
        ),
        pins=(),
        plates=(),
        cords=cords,
        bill=bill(device, made, cords, {n: count for n, (_, count, _) in pins.items()}),
        assembly=_assembly(made),
        marker_seats=tuple(
            TagSeat(s.number, s.center, s.axes[:, 0], s.axes[:, 2], device.fabrication.marker_size)
            for s in made.seats
        ),
        checks=made.checks,
        prediction=prediction,
        removed_volume=made.cut_out,
        body_volume=made.body_volume,
        assembly_of_cords=device.fabrication.assembly,
        warnings=(
            *made.warnings,
            *_warnings(device, layout),
            *_too_long(device, cords),
        ),
    )


def _too_long(device: Device, cords: Sequence[CutCord]) -> list[str]:
    """Cords that take a longer piece than there is, for an end of theirs hangs out."""
    longest = device.cord.lengths[1]
    return [
        f"cord {c.sensor} takes a piece of {c.cut_length:.0f} mm, more than the {longest:g} mm of"
        " [cord] length: "
        + (
            "an end of it has no pocket and hangs out; use a longer piece, or a shorter"
            " [fabrication] lead"
            if all(e.after is None for e in c.ends)
            else "an end of it hangs out until a joint that it passes through is closed; use a"
            " longer piece"
        )
        for c in cords
        if c.cut_length > longest
    ]


def _warnings(device: Device, layout: LayoutRecord) -> list[str]:
    """What the maker should know of the cords as they are built in."""
    cord, bonded = device.cord, device.fabrication.assembly == "bonded"
    warnings = [
        f"cord {s.name} is stretched by {s.peak_strain:.0%}, more than its {cord.max_strain:.0%}"
        for s in layout.sensors
        if s.peak_strain > cord.max_strain
    ]
    warnings += [
        f"cord {s.name} is slack where the body is compressed along it the most, by"
        f" {-s.least_strain:.1%}, and senses nothing of that; leave prestretch out of"
        " [fabrication], or give more"
        for s in layout.sensors
        if not bonded and s.least_strain < 0
    ]
    pressed = any(s.least_strain < 0 for s in layout.sensors)
    if bonded and pressed and cord.compression != "measured":
        warnings.append(
            "bonded cords are compressed, and how their resistance answers to that was not"
            f" measured: it is taken to be {ANSWERS[cord.compression]}; calibrate the cord, or"
            ' take assembly = "held", which stretches cords so far that none is compressed'
        )
    soft = device.material.young_modulus * device.channel_diameter**2
    if bonded and cord.modulus * cord.diameter**2 > _STIFF * soft:
        warnings.append(
            f"the cord ({cord.modulus:g} MPa) is stiffer than {device.material.name}"
            f" ({device.material.young_modulus:.2g} MPa), which is not in the simulation: bonded"
            " cords are strained some per cent less than predicted, and their training finds that"
        )
    return warnings


def _part(made: PartSet, i: int, cast: bool) -> PartRecord:
    one = made.parts[i]
    step, volume = None, None
    if one.solid is not None:
        from ...geometry.kernels import occ

        step, volume = f"{one.name}.step", occ.volume(one.solid)
    return PartRecord(
        name=one.name,
        number=i + 1,
        stl=f"{one.name}.stl",
        print=f"{one.name}.stl" if cast else f"{LYING}/{one.name}.stl",
        step=step,
        volume=one.volume,
        bbox=one.surface.bounds,
        sockets=tuple(
            Socket(p.center, p.axis, p.socket)
            for p in made.pins
            if i in (made.contacts[p.contact].lower, made.contacts[p.contact].upper)
        ),
        step_volume=volume,
    )


def _assembly(made: PartSet) -> tuple[JoinStep, ...]:
    """The steps in which the device is closed: the cuts backwards."""
    steps = []
    for k in reversed(range(len(made.cuts))):
        cut = made.cuts[k]
        low, high = (tuple(made.parts[i].name for i in side) for side in cut.sides)
        steps.append(
            JoinStep(
                join=(low, high),
                cords=tuple(made.channels[c].name for c in cut.cords if c not in cut.wires),
                wires=tuple(made.channels[c].name for c in cut.wires),
                opens=cut.plane.normal,
                pins=tuple(
                    JoinedPin(
                        name=f"pin-{p.diameter:g}x{p.length:.1f}",
                        center=p.center,
                        socket=p.socket,
                        depth=p.depth,
                        between=(
                            made.parts[made.contacts[p.contact].lower].name,
                            made.parts[made.contacts[p.contact].upper].name,
                        ),
                    )
                    for p in made.pins
                    if made.contacts[p.contact].cut == k
                ),
            )
        )
    return tuple(steps)
