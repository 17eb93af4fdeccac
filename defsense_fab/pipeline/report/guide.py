"""What the assembly guide says: parts to print, cords to cut, what to buy, steps with pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device import Device
from ...core.mesh import Surface
from ..artifacts.layout import LayoutRecord
from ..artifacts.manifest import CutCord, JoinStep, Manifest, WireRecord
from . import pictures


@dataclass(frozen=True)
class AssemblyStep:
    """A title, sentences, and a picture (PNG as a data URI) or none."""

    title: str
    lines: tuple[str, ...]
    picture: str | None = None


@dataclass(frozen=True)
class GuideTable:
    """Rows of texts under a header."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Guide:
    """All that the guide says, for either format."""

    title: str
    intro: str
    warnings: tuple[str, ...]
    exploded: str
    tables: tuple[GuideTable, ...]
    steps: tuple[AssemblyStep, ...]
    checks: GuideTable


def shifts(manifest: Manifest, parts: Mapping[str, Surface]) -> dict[str, Float]:
    """Where each part goes, (3,) mm, when every cut is opened along its normal."""
    out = {name: np.zeros(3) for name in parts}
    size = float(np.linalg.norm(np.ptp([s.bounds for s in parts.values()], axis=(0, 1))))
    for step in manifest.assembly:
        for side, sign in zip(step.join, (-1, 1), strict=True):
            for name in side:
                out[name] = out[name] + sign * 0.1 * size * step.opens
    return out


def assembly_guide(
    device: Device,
    layout: LayoutRecord,
    manifest: Manifest,
    parts: Mapping[str, Surface],
    view: Float,
) -> Guide:
    """The guide of a device with its parts by name; pictures look along `view` (3,), rest frame."""
    return Guide(
        title=f"{device.name}: assembly guide",
        intro=f"{len(manifest.parts)} parts, {len(manifest.cords)} cords. All lengths in mm.",
        warnings=tuple(manifest.warnings),
        exploded=pictures.exploded(parts, shifts(manifest, parts), view),
        tables=(_parts(manifest), _cuts(manifest), _bill(manifest)),
        steps=(
            *_preparation(device, manifest),
            *_joints(device, layout, manifest, parts),
            _wiring(manifest),
        ),
        checks=_checks(manifest),
    )


def _parts(manifest: Manifest) -> GuideTable:
    where = {n: p.file for p in manifest.plates for n in p.parts}
    rows = [
        (
            p.name,
            "1",
            " x ".join(f"{b - a:.1f}" for a, b in zip(*p.bbox, strict=True)),
            f"{p.volume / 1000:.1f}",
            where[p.name],
        )
        for p in manifest.parts
    ]
    rows += [
        (p.name, str(p.count), f"{p.diameter:g} x {p.length:.1f}", "",
         where[f"{p.name}_1"])
        for p in manifest.pins
    ]  # fmt: skip
    return GuideTable("Print", ("part", "copies", "size", "cm3", "on plate"), tuple(rows))


def _cuts(manifest: Manifest) -> GuideTable:
    rows = [
        (
            c.sensor,
            f"{c.cut_length:.0f}",
            f"{c.slack:.0f}",
            f"{c.unstretched:.1f}",
            "bonded" if c.prestretch is None else f"{c.prestretch:.0%}",
            " / ".join(
                "in pocket" if e.joint == "pocket" else f"{e.lead:.0f} free" for e in c.ends
            ),
            f"{c.resistance_before:.0f} / {c.resistance:.0f}",
            f"{c.range[0]:.0f} to {c.range[1]:.0f}",
            f"{c.reference_resistor:g}",
            " / ".join(_leaves(e.wire) for e in c.ends),
        )
        for c in manifest.cords
    ]
    header = (
        "cord", "cut to", "of it slack", "between joints", "stretched by", "joints at start / end",
        "ohm loose / laid", "ohm in use", "reference, ohm", "wires leave",
    )  # fmt: skip
    return GuideTable("Cut list", header, tuple(rows))


def _leaves(wire: WireRecord) -> str:
    """Where a wire leaves the body, and after how many mm in it."""
    inside = f" ({wire.length:.0f})" if wire.length else ""
    return str(wire.leaves) + inside


def _bill(manifest: Manifest) -> GuideTable:
    rows = tuple((b.item, b.amount, b.use) for b in manifest.bill)
    return GuideTable("Bill of materials", ("item", "amount", "for"), rows)


def _checks(manifest: Manifest) -> GuideTable:
    rows = tuple(
        (
            c.name,
            f"{c.value:.3g} {c.unit}".strip(),
            f"{c.limit:.3g} {c.unit}".strip(),
            c.at,
        )
        for c in manifest.checks
    )
    return GuideTable("Checked before writing", ("what", "measured", "limit", "near"), rows)


def _preparation(device: Device, manifest: Manifest) -> list[AssemblyStep]:
    plates = ", ".join(p.file for p in manifest.plates)
    printing = [
        f"Print {plates} ({device.fabrication.process}, {device.material.name}): parts lie on a cut"
        " face where they have one to lie on; grooves and sockets need no support.",
        "A part's number is engraved in a face that vanishes in the device, where there is room.",
    ]
    if manifest.pins:
        printing.append(
            "Try every pin in its socket: the two pins of a joint differ in diameter, and no two"
            " joints have them equally far apart."
        )
    cords = [
        f"Cut {c.sensor} to {c.cut_length:.0f} mm, {c.slack:.0f} mm of it to trim later."
        f" It should measure about {c.cut_length * device.cord.ohm_per_mm:.0f} ohm." + _crimping(c)
        for c in manifest.cords
    ]
    cords.append("A piece that differs by more than 10 % is of another batch: change"
                 " ohm_per_mm in the cord's table.")  # fmt: skip
    return [
        AssemblyStep("Print", tuple(printing)),
        AssemblyStep("Cut the cords and crimp their wires", tuple(cords)),
    ]


def _crimping(cord: CutCord) -> str:
    """Where the wires go before the cord is laid."""
    ferrules = all(e.joint == "pocket" for e in cord.ends)
    what = "ferrules" if ferrules else "joints"
    laid = ""
    if cord.prestretch:
        laid = (
            f": stretched by {cord.between_ferrules - cord.unstretched:.1f} mm as it is laid, it"
            f" fills the {cord.between_ferrules:.1f} mm between them in the device"
        )
    return (
        f" Crimp a wire to either end, {cord.unstretched:.1f} mm of loose cord between the"
        f" {what}{laid}; then it measures about {cord.resistance_before:.0f} ohm."
    )


def _joints(
    device: Device, layout: LayoutRecord, manifest: Manifest, parts: Mapping[str, Surface]
) -> list[AssemblyStep]:
    paths = {s.name: s.points for s in layout.sensors}
    colors = {n: pictures.COLORS[i % len(pictures.COLORS)] for i, n in enumerate(parts)}
    cut_to = {c.sensor: c for c in manifest.cords}
    left = [c for step in manifest.assembly for c in step.cords]
    laid: set[str] = set()
    out = []
    for step in manifest.assembly:
        low, high = step.join
        normal = step.opens
        lower, upper = ({n: parts[n] for n in side} for side in (low, high))
        # The lighter side is the one to lift.
        volumes = [sum(s.volume for s in side.values()) for side in (lower, upper)]
        if volumes[1] > volumes[0]:
            low, high, lower, upper, normal = high, low, upper, lower, -normal
        size = np.ptp([s.bounds for s in (*lower.values(), *upper.values())], axis=(0, 1))
        lift = 0.4 * float(np.linalg.norm(size))
        cords = [paths[c] for c in step.cords]
        picture = pictures.joining(
            lower,
            upper,
            colors,
            normal,
            lift,
            [(line, "#222222", device.cord.diameter / 2) for line in cords]
            + [(w, "#c1121f", device.fabrication.wire_diameter / 2) for w in _wires(step, cut_to)],
            [(p.center, p.socket, 2 * p.depth) for p in step.pins],
        )
        out.append(
            AssemblyStep(
                f"Join {_all(low)} and {_all(high)}",
                tuple(_joint(step, cut_to, laid, left)),
                picture,
            )
        )
    return out


def _wires(step: JoinStep, cut_to: Mapping[str, CutCord]) -> list[Float]:
    """Lines (p, 3) mm of the wires that are laid in a step."""
    found = []
    for name in [*step.cords, *step.wires]:
        for wire in (e.wire for e in cut_to[name].ends):
            if wire.path is not None:
                drop = [] if wire.drop is None else [wire.path[-1:] + wire.drop]
                found.append(np.concatenate([wire.path, *drop]))
    return found


def _joint(
    step: JoinStep,
    cut_to: Mapping[str, CutCord],
    laid: set[str],
    left: list[str],
) -> list[str]:
    """What to do; cords move from those `left` to lay to those `laid`."""
    lines = []
    if step.pins:
        lines.append(f"Put in {_counted([p.name for p in step.pins])}.")
    for name in step.cords:
        left.remove(name)
        begun, goes_on = name in laid, name in left
        laid.add(name)
        if begun or goes_on:
            lines.append(
                f"Lay {'the next' if begun else 'the first'} stretch of cord {name} into its groove"
                + ("; the rest hangs out until a later joint." if goes_on else ", its last.")
            )
            if not goes_on:
                lines += _laying(cut_to[name])
            continue
        start, end = (
            f"{what} in its pocket" if e.joint == "pocket" else f"{what} {e.lead:.0f} mm out"
            for e, what in zip(cut_to[name].ends, ("start", "end"), strict=True)
        )
        lines.append(f"Lay cord {name} into its groove: {start}, {end}.")
        lines += _laying(cut_to[name])
    for name in step.wires:
        lines.append(f"Of cord {name}, only its wire runs here: lay it into its groove.")
    lines.append("Close the joint dry first. Then glue the faces" + _gluing(step, cut_to))
    return lines


def _gluing(step: JoinStep, cut_to: Mapping[str, CutCord]) -> str:
    """What the glue of a joint has to do with its cords."""
    if not step.cords:
        return "."
    if all(cut_to[name].prestretch is None for name in step.cords):
        return ", and with them the cord into its groove all along."
    return "; keep glue out of the grooves: the cord must slide."


def _laying(cord: CutCord) -> list[str]:
    """What to do with a cord that lies in its groove whole, and its wires."""
    lines = []
    if not cord.prestretch:
        lines.append("Lay it without stretching it.")
    else:
        pull = cord.between_ferrules - cord.unstretched
        free = [w for e, w in zip(cord.ends, ("start", "end"), strict=True) if e.joint != "pocket"]
        lines.append(
            f"Stretch it by {pull:.1f} mm ({cord.prestretch:.0%}) as you lay it"
            + (
                ", so that both ferrules rest against the bottoms of their pockets, which hold it."
                if not free
                else f". At its {' and '.join(free)} no pocket holds it: glue its last 5 mm into"
                " the groove at the mouth, and let that set before you let go."
            )
            + f" It should measure about {cord.resistance:.0f} ohm then."
        )
    for end, what in zip(cord.ends, ("start", "end"), strict=True):
        wire = end.wire
        if wire.leaves == "bend":
            lines.append(
                f"Its wire at the {what} leaves by the bend beside the mouth, which holds it when"
                " it is pulled."
            )
        elif wire.leaves == "bay" and wire.length:
            hole = " and through the hole at the end of it" if wire.drop is not None else ""
            lines.append(
                f"Its wire at the {what} goes along its groove{hole} into the bay,"
                f" {wire.length:.0f} mm."
            )
    return lines


def _wiring(manifest: Manifest) -> AssemblyStep:
    lines = [
        f"{c.sensor}: about {c.resistance:.0f} ohm between its wires at rest, reference"
        f" resistor {c.reference_resistor:g} ohm to the supply."
        for c in manifest.cords
    ]
    lines.insert(
        0, "Measure every cord after every joint: a value that jumps means a pinched cord.",
    )  # fmt: skip
    return AssemblyStep("Wire and measure", tuple(lines))


def _all(names: Sequence[str]) -> str:
    return " + ".join(names)


def _counted(names: Sequence[str]) -> str:
    return ", ".join(f"{list(names).count(n)} x {n}" for n in dict.fromkeys(names))
