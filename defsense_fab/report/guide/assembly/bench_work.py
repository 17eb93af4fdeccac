"""What the guide says of what is done before parts are joined, and after."""

from __future__ import annotations

from ....core.device.device import Device
from ....geometry.channels import cord_assembly
from ....store.manifest import CutCord
from .actions import Action, Expected
from .plan import BATCH, LAID, anchored_later
from .wording import ENDS, Words, called, limits


def print_parts(w: Words, _: Action) -> list[str]:
    """What comes off the printer."""
    plates = ", ".join(p.file for p in w.manifest.plates)
    process = w.device.fabrication.process
    if w.manifest.casting is not None:
        return [f"Print the moulds: {plates} ({process}).", *w.manifest.advice]
    out = [f"Print {plates} ({process}, {w.device.material.name}).", *w.manifest.advice]
    if w.manifest.parts:
        out.append(
            "A part's number is engraved in a face that vanishes in the device, where there is"
            " room."
        )
    return out


def cast_parts(w: Words, _: Action) -> list[str]:
    """What is poured, and taken out."""
    return [] if w.manifest.casting is None else list(w.manifest.casting.steps)


def try_pins(w: Words, _: Action) -> list[str]:
    """Before anything is glued."""
    fit = "; 'defsense calibrate coupon' finds the clearance of a printer with which they do"
    return [
        "Try every pin in its socket: the two pins of a joint differ in diameter, and no two joints"
        " have them equally far apart. Each goes in by hand and does not fall out"
        f"{fit if w.manifest.casting is None else ''}."
    ]


def cut(w: Words, action: Action) -> list[str]:
    """Length and resistance of a piece."""
    cord = w.cord(action)
    ohm = cord.cut_length * w.device.cord.ohm_per_mm
    return [
        f"Cut {called(cord.sensor)} to {cord.cut_length:.0f} mm: about {ohm:.0f} ohm"
        f" ({(1 - BATCH) * ohm:.0f} to {(1 + BATCH) * ohm:.0f}) from end to end. A piece beyond"
        " that is of another batch: change ohm_per_mm in the cord's table."
    ]


def crimp(w: Words, action: Action) -> list[str]:
    """A wire at an end."""
    cord = w.cord(action)
    assert action.end is not None
    wire = cord.ends[action.end].wire
    out = [
        f"Crimp a wire to the {ENDS[action.end]} of {called(cord.sensor)}: cord and wire meet in"
        " the middle of the ferrule."
    ]
    if wire.leaves == "bay" and wire.length:
        out[0] += " Leave the wire's other end bare: it has to go through the body."
    return out


def mark(w: Words, action: Action) -> list[str]:
    """Where the other ferrule comes."""
    cord, end = w.cord(action), action.end
    assert end is not None
    out = (
        f"Mark {called(cord.sensor)} {cord.unstretched:.1f} mm from the middle of that"
        f" ferrule, loose: there its {ENDS[end]} will be."
    )
    after = cord.ends[end].after
    if after is not None:
        out += (
            " Leave what is beyond the mark on it, and that end without a ferrule, until step"
            f" {w.numbers[after] + 1}: the cord has to slide till then."
        )
    elif not cord.stretches:
        out += " Leave that end without a ferrule until the cord is in its channel."
    return [out]


def trim(w: Words, action: Action) -> list[str]:
    """What is beyond the mark."""
    cord = w.cord(action)
    off = cord.cut_length - cord.unstretched
    return [f"Cut {called(cord.sensor)} off at its mark: {off:.0f} mm come off."]


def measure(w: Words, action: Action) -> list[str]:
    """What to expect, and what to do when it is not so."""
    if action.joint is None and action.cord and w.cord(action).stretches:
        (expected,) = action.expected
        return [
            f"Measure {called(expected.cord)}, loose: {limits(expected)}. Note the value. More, or"
            " nothing: crimp again. Less: its length between the ferrules is too short; cut a new"
            " piece."
        ]
    told = "; ".join(f"{called(e.cord)} {_in_place(w, e)}" for e in action.expected)
    where = "" if action.joint is None or action.cord else " while the glue is wet"
    off = (
        "The value jumps, or is higher: the cord is pinched or a ferrule has slipped; "
        + ("open the joint" if where else "pull the end out")
        + ", and lay it again. None at all: a crimp is loose. Lower: two wires touch."
    )
    return [f"Measure{where}: {told}. {off}"]


def _in_place(w: Words, expected: Expected) -> str:
    """The value in the device, and what it is beside that of the loose cord."""
    cord = next(c for c in w.manifest.cords if c.sensor == expected.cord)
    out = limits(expected)
    ratio = cord.resistance / cord.resistance_before
    if anchored_later(cord) is None and cord.stretches:
        out += f", {ratio:.2f} times what you noted, within {LAID:.0%}"
    return out


def thread(w: Words, action: Action) -> list[str]:
    """Through a closed channel."""
    return [
        f"Push {called(w.cord(action).sensor)} through its channel from the start, and out of its"
        " end."
    ]


def connect(w: Words, action: Action) -> list[str]:
    """The cords to the read-out board."""
    cords = {c.sensor: c for c in w.manifest.cords}
    lines = [
        f"Wire {called(e.cord)} to the board: reference resistor"
        f" {cords[e.cord].reference_resistor:g} ohm to the supply; the cord has"
        f" {limits(e)} between its wires at rest."
        for e in action.expected
    ]
    if lines:
        lines.append(
            "Bend the device gently by hand: every value moves and comes back. One that jumps tells"
            " of a pinched cord or a loose crimp."
        )
    return lines or ["The device has no cords: there is nothing to wire."]


def pull(w: Words, action: Action) -> list[str]:
    """An end that is crimped outside of its mouth."""
    cord, end = w.cord(action), action.end
    assert end is not None
    reach = reach_of(w.device, cord, end)
    return [
        f"Pull {called(cord.sensor)} out of its mouth at the {ENDS[end]} until the mark is"
        f" {reach:.0f} mm outside, and hold it there with a clip on the cord at the mouth"
        f" (it is stretched by {pulled(w.device, cord, end):.0%} then)."
    ]


def reach_of(device: Device, cord: CutCord, end: int) -> float:
    """How far outside of its mouth the mark of an end must be for its ferrule to be crimped, mm."""
    return cord_assembly.crimping_reach(device.cord.ferrule_length, cord.ends[end].lead)


def pulled(device: Device, cord: CutCord, end: int) -> float:
    """By how much of its length a cord is stretched with its mark that far out."""
    record = cord.ends[end]
    return cord_assembly.crimping_strain(
        cord.between_ferrules, cord.unstretched, record.pocket, device.cord.ferrule_length,
        record.lead,
    )  # fmt: skip


def seat(w: Words, action: Action) -> list[str]:
    """That end back into its place."""
    cord, end = w.cord(action), action.end
    assert end is not None
    if cord.ends[end].joint == "pocket":
        held = "" if cord.prestretch else " Press it in while the glue in the groove is wet."
        return [
            f"Let {called(cord.sensor)} draw the ferrule into its pocket, until it rests against"
            f" the bottom.{held}"
        ]
    return [
        f"Let {called(cord.sensor)} in until the middle of the ferrule is"
        f" {cord.ends[end].lead:.0f} mm out of the mouth, and hold it there."
    ]
