"""Write the instructions for work at the bench: before parts are joined, and after."""

from __future__ import annotations

from ....core.device.device import Device
from ....geometry.channels import cord_assembly
from ....store.manifest import CutCord
from .actions import Action, ExpectedResistance
from .plan import BATCH_TOLERANCE, INSTALLED_TOLERANCE, late_end
from .wording import ENDS, GuideContext, cord_label, format_resistance


def print_parts(context: GuideContext, _: Action) -> list[str]:
    """Instruct to print the plates, with the printing advice of the manifest."""
    manifest = context.manifest
    plates = ", ".join(p.file for p in manifest.plates)
    process = context.device.fabrication.process
    if manifest.casting is not None:
        return [f"Print the moulds: {plates} ({process}).", *manifest.advice]
    lines = [f"Print {plates} ({process}, {context.device.material.name}).", *manifest.advice]
    if manifest.parts:
        lines.append(
            "Find each part's number on a face that is hidden in the finished device. Small parts"
            " may have no number."
        )
    return lines


def cast_parts(context: GuideContext, _: Action) -> list[str]:
    """Instruct to cast the parts, as the manifest describes it."""
    casting = context.manifest.casting
    return [] if casting is None else list(casting.steps)


def try_pins(context: GuideContext, _: Action) -> list[str]:
    """Instruct to try all pins before anything is glued."""
    lines = [
        "Try every pin in its socket. Each must go in by hand and must not fall out.",
        "The two pins of a joint differ in diameter, and their distance is different in every"
        " joint.",
    ]
    if context.manifest.casting is None:
        lines.append(
            "If the pins do not fit, run 'defsense calibrate coupon' to find the clearance of your"
            " printer."
        )
    return lines


def cut_cord(context: GuideContext, action: Action) -> list[str]:
    """Instruct to cut a cord, and state the resistance of the piece."""
    cord = context.cord(action)
    ohm = cord.cut_length * context.device.cord.ohm_per_mm
    return [
        f"Cut {cord_label(cord.sensor)} to {cord.cut_length:.0f} mm.",
        f"Measure the piece from end to end: about {ohm:.0f} ohm"
        f" ({(1 - BATCH_TOLERANCE) * ohm:.0f} to {(1 + BATCH_TOLERANCE) * ohm:.0f}). If it is"
        " outside these limits, the cord is of another batch: change ohm_per_mm in the cord's"
        " table.",
    ]


def crimp_wire(context: GuideContext, action: Action) -> list[str]:
    """Instruct to crimp a wire to an end of a cord."""
    cord = context.cord(action)
    assert action.end is not None
    wire = cord.ends[action.end].wire
    lines = [
        f"Crimp a wire to the {ENDS[action.end]} of {cord_label(cord.sensor)}. Cord and wire must"
        " meet in the middle of the ferrule."
    ]
    if wire.leaves == "bay" and wire.length:
        lines.append("Leave the wire's other end bare: it must pass through the body.")
    return lines


def mark_cord(context: GuideContext, action: Action) -> list[str]:
    """Instruct to mark the place of the second ferrule."""
    cord, end = context.cord(action), action.end
    assert end is not None
    lines = [
        f"Mark {cord_label(cord.sensor)} {cord.unstretched:.1f} mm from the middle of that"
        f" ferrule. Do not stretch it. The mark is the place of its {ENDS[end]}."
    ]
    after = cord.ends[end].after
    if after is not None:
        lines.append(
            "Do not cut off the cord beyond the mark, and do not crimp that end, before step"
            f" {context.step_numbers[after] + 1}: the cord must be able to slide until then."
        )
    elif not cord.stretches:
        lines.append("Do not crimp that end before the cord is in its channel.")
    return lines


def trim_cord(context: GuideContext, action: Action) -> list[str]:
    """Instruct to cut a cord off at its mark."""
    cord = context.cord(action)
    excess = cord.cut_length - cord.unstretched
    return [f"Cut {cord_label(cord.sensor)} at its mark. This removes {excess:.0f} mm."]


def measure_cords(context: GuideContext, action: Action) -> list[str]:
    """Instruct to measure cords, with the expected values and remedies."""
    if action.joint is None and action.cord and context.cord(action).stretches:
        (expected,) = action.expected
        return [
            f"Measure {cord_label(expected.cord)} without stretching it:"
            f" {format_resistance(expected)}. Note the value.",
            "If the value is higher or there is none, crimp again. If it is lower, the length"
            " between the ferrules is too short: cut a new piece.",
        ]
    values = "; ".join(
        f"{cord_label(e.cord)} {_format_installed(context, e)}" for e in action.expected
    )
    is_wet = action.joint is not None and not action.cord
    remedy = "open the joint" if is_wet else "pull the end out"
    return [
        f"Measure{' while the glue is wet' if is_wet else ''}: {values}.",
        "If the value jumps or is higher, the cord is pinched or a ferrule has slipped:"
        f" {remedy} and insert the cord again. If there is no value, a crimp is loose. If the"
        " value is lower, two wires touch.",
    ]


def _format_installed(context: GuideContext, expected: ExpectedResistance) -> str:
    """Format a resistance in the device, with its ratio to that of the loose cord."""
    cord = next(c for c in context.manifest.cords if c.sensor == expected.cord)
    text = format_resistance(expected)
    if late_end(cord) is None and cord.stretches:
        ratio = cord.resistance / cord.resistance_before
        text += f", {ratio:.2f} times the value you noted, within {INSTALLED_TOLERANCE:.0%}"
    return text


def thread_cord(context: GuideContext, action: Action) -> list[str]:
    """Instruct to push a cord through a closed channel."""
    label = cord_label(context.cord(action).sensor)
    return [f"Push {label} through its channel, from the channel's start, until it comes out."]


def connect_cords(context: GuideContext, action: Action) -> list[str]:
    """Instruct to connect the cords to the read-out board."""
    cords = {c.sensor: c for c in context.manifest.cords}
    lines = [
        f"Connect {cord_label(e.cord)} to the board, with a reference resistor of"
        f" {cords[e.cord].reference_resistor:g} ohm to the supply. Between its wires the cord has"
        f" {format_resistance(e)} at rest."
        for e in action.expected
    ]
    if lines:
        lines.append(
            "Bend the device gently by hand. Every value must change and return. If a value jumps,"
            " a cord is pinched or a crimp is loose."
        )
    return lines or ["This device has no cords: there is nothing to connect."]


def pull_end(context: GuideContext, action: Action) -> list[str]:
    """Instruct to pull an end out of its mouth, where it is crimped."""
    cord, end = context.cord(action), action.end
    assert end is not None
    reach = pulled_reach(context.device, cord, end)
    return [
        f"Pull the {ENDS[end]} of {cord_label(cord.sensor)} out of its mouth until the mark is"
        f" {reach:.0f} mm outside. This stretches the cord by"
        f" {pulled_strain(context.device, cord, end):.0%}.",
        "Hold it there with a clip on the cord at the mouth.",
    ]


def pulled_reach(device: Device, cord: CutCord, end: int) -> float:
    """Return how far outside its mouth an end's mark must be to crimp its ferrule, mm."""
    return cord_assembly.crimping_reach(device.cord.ferrule_length, cord.ends[end].lead)


def pulled_strain(device: Device, cord: CutCord, end: int) -> float:
    """Return the strain of a cord whose mark is pulled out that far."""
    record = cord.ends[end]
    return cord_assembly.crimping_strain(
        cord.between_ferrules,
        cord.unstretched,
        record.pocket,
        device.cord.ferrule_length,
        record.lead,
    )


def seat_end(context: GuideContext, action: Action) -> list[str]:
    """Instruct to let a crimped end back into its place."""
    cord, end = context.cord(action), action.end
    assert end is not None
    label = cord_label(cord.sensor)
    if cord.ends[end].joint == "pocket":
        lines = [f"Let {label} draw the ferrule into its pocket until it touches the bottom."]
        if not cord.prestretch:
            lines.append("Press it in while the glue in the groove is wet.")
        return lines
    return [
        f"Let {label} in until the middle of the ferrule is {cord.ends[end].lead:.0f} mm outside"
        " the mouth, and hold it there."
    ]
