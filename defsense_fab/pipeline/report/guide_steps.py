"""What the assembly guide says, without its pictures: the steps in their order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device import Device
from ...core.mesh import Surface
from ..artifacts.manifest import CutCord, JoinedPin, JoinStep, Manifest


@dataclass(frozen=True)
class Joint:
    """What is joined in a step: the names of the `lower` parts and of the lighter `upper` ones,
    which are lifted by `lift` mm along `opens` (3,); cords by name, lines (p, 3) mm of wires, and
    pins."""

    lower: tuple[str, ...]
    upper: tuple[str, ...]
    opens: Float
    lift: float
    cords: tuple[str, ...]
    wires: tuple[Float, ...]
    pins: tuple[JoinedPin, ...]


@dataclass(frozen=True)
class GuideStep:
    """A title, sentences, and what is joined, if anything is."""

    title: str
    lines: tuple[str, ...]
    joint: Joint | None = None


def shifts(manifest: Manifest, parts: Mapping[str, Surface]) -> dict[str, Float]:
    """Where each part goes, (3,) mm, when every cut is opened along its normal."""
    out = {name: np.zeros(3) for name in parts}
    size = float(np.linalg.norm(np.ptp([s.bounds for s in parts.values()], axis=(0, 1))))
    for step in manifest.assembly:
        for side, sign in zip(step.join, (-1, 1), strict=True):
            for name in side:
                out[name] = out[name] + sign * 0.1 * size * step.opens
    return out


def guide_steps(
    device: Device, manifest: Manifest, parts: Mapping[str, Surface]
) -> tuple[GuideStep, ...]:
    """All steps of a device with its parts by name."""
    return (*_preparation(device, manifest), *_joints(manifest, parts), _wiring(manifest))


def _preparation(device: Device, manifest: Manifest) -> list[GuideStep]:
    plates = ", ".join(p.file for p in manifest.plates)
    printing = [
        f"Print {plates} ({device.fabrication.process}, {device.material.name}): parts lie on a cut"
        " face where they have one to lie on; grooves and sockets need no support."
        if manifest.casting is None
        else f"Print the moulds: {plates} ({device.fabrication.process}).",
        *manifest.advice,
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
    cast = [GuideStep("Cast the parts", manifest.casting.steps)] if manifest.casting else []
    return [
        GuideStep("Print", tuple(printing)),
        *cast,
        GuideStep("Cut the cords and crimp their wires", tuple(cords)),
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


def _joints(manifest: Manifest, parts: Mapping[str, Surface]) -> list[GuideStep]:
    cut_to = {c.sensor: c for c in manifest.cords}
    left = [c for step in manifest.assembly for c in step.cords]
    laid: set[str] = set()
    out = []
    for step in manifest.assembly:
        joint = _opened(step, cut_to, parts)
        lines = tuple(_joint(step, cut_to, laid, left))
        out.append(GuideStep(f"Join {_all(joint.lower)} and {_all(joint.upper)}", lines, joint))
    return out


def _opened(step: JoinStep, cut_to: Mapping[str, CutCord], parts: Mapping[str, Surface]) -> Joint:
    """The lighter side is the one to lift."""
    low, high = step.join
    normal = step.opens
    lower, upper = ([parts[n] for n in side] for side in (low, high))
    if sum(s.volume for s in upper) > sum(s.volume for s in lower):
        low, high, normal = high, low, -normal
        lower, upper = upper, lower
    size = np.ptp([s.bounds for s in (*lower, *upper)], axis=(0, 1))
    lift = 0.4 * float(np.linalg.norm(size))
    return Joint(low, high, normal, lift, step.cords, tuple(_wires(step, cut_to)), step.pins)


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


def _wiring(manifest: Manifest) -> GuideStep:
    lines = [
        f"{c.sensor}: about {c.resistance:.0f} ohm between its wires at rest, reference"
        f" resistor {c.reference_resistor:g} ohm to the supply."
        for c in manifest.cords
    ]
    lines.insert(
        0, "Measure every cord after every joint: a value that jumps means a pinched cord.",
    )  # fmt: skip
    return GuideStep("Wire and measure", tuple(lines))


def _all(names: Sequence[str]) -> str:
    return " + ".join(names)


def _counted(names: Sequence[str]) -> str:
    return ", ".join(f"{list(names).count(n)} x {n}" for n in dict.fromkeys(names))
