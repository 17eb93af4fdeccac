"""Write the instructions for work at an open joint."""

from __future__ import annotations

from ....store.manifest import CutCord
from .actions import Action
from .plan import (
    joint_of_end,
    joints_that_stretch,
    joints_to_slide_in,
    last_joint_while_wet,
    late_end,
)
from .wording import (
    ENDS,
    GuideContext,
    capitalize_first,
    cord_label,
    describe_sides,
    join_names,
    pin_letters,
)


def dry_fit(context: GuideContext, action: Action) -> list[str]:
    """Instruct to join the parts without glue, and to separate them again."""
    joint = context.joint(action)
    pins = ", with their pins" if joint.pins else ""
    return [
        f"Put {describe_sides(joint)} together without glue{pins}. The faces must meet all around.",
        "Separate the parts again.",
    ]


def insert_pins(context: GuideContext, action: Action) -> list[str]:
    """Instruct which pin goes into which socket."""
    joint = context.joint(action)
    kinds = {p.name: p for p in context.manifest.pins}
    lines = ["Put the pins into the sockets of one side, by their letters in the picture."]
    for pair in dict.fromkeys(p.between for p in joint.pins):
        lettered = [
            (letter, kinds[p.name])
            for letter, p in zip(pin_letters(joint), joint.pins, strict=True)
            if p.between == pair
        ]
        diameters = [kind.diameter for _, kind in lettered]
        descriptions = []
        for letter, kind in lettered:
            rank = ""
            if len(set(diameters)) > 1:
                ranks = {max(diameters): "the thicker, ", min(diameters): "the thinner, "}
                rank = ranks.get(kind.diameter, "")
            descriptions.append(
                f"{letter}: {rank}{kind.diameter:g} mm thick, {kind.length:.1f} mm long"
            )
        lines.append(f"Between {join_names(pair)}: {'; '.join(descriptions)}.")
    return lines


def lay_cord(context: GuideContext, action: Action) -> list[str]:
    """Instruct to insert a stretch of a cord into its groove, with the ends that it has."""
    cord, j = context.cord(action), action.joint or 0
    label = cord_label(cord.sensor)
    parts = " + ".join(context.lower_parts[j])
    if len(cord.stretches) > 1:
        here = [s for s in cord.stretches if s.joint == j]
        ranges = join_names([f"from {s.start:.0f} to {s.stop:.0f} mm" for s in here])
        lines = [
            f"Insert {label} into the groove of {parts} {ranges}, measured from the start of its"
            f" channel of {cord.channel_length:.0f} mm."
        ]
        if all(s.joint <= j for s in cord.stretches):
            lines.append("The rest of the cord is already inserted.")
    else:
        lines = [f"Insert {label} into the groove of {parts}."]
    lines += [_describe_end(cord, end) for end in (0, 1) if joint_of_end(cord, end) == action.joint]
    if any(s.joint > j for s in cord.stretches):
        lines.append("Let the rest of the cord hang out until a later joint.")
    if not cord.prestretch and j == max(s.joint for s in cord.stretches):
        lines.append(f"Do not stretch {label}.")
    return lines


def _describe_end(cord: CutCord, end: int) -> str:
    name, record = ENDS[end], cord.ends[end]
    if record.after is not None:
        return f"Let its {name}, without a ferrule, hang out of the mouth."
    if record.joint == "pocket":
        return f"Put the ferrule of its {name} into its pocket."
    return (
        f"Let its {name} out of the mouth, with the middle of the ferrule"
        f" {record.lead:.0f} mm outside."
    )


def stretch_cord(context: GuideContext, action: Action) -> list[str]:
    """Instruct how far to stretch a cord, and what holds it."""
    cord = context.cord(action)
    elongation = cord.between_ferrules - cord.unstretched
    line = f"Stretch {cord_label(cord.sensor)} by {elongation:.1f} mm ({cord.prestretch or 0:.0%})"
    free_ends = [k for k, e in enumerate(cord.ends) if e.joint == "free"]
    if not free_ends:
        lines = [f"{line}, until both ferrules touch the bottoms of their pockets, which hold it."]
    else:
        end = free_ends[-1]
        lines = [
            f"{line} from its {ENDS[end]}, until the middle of the ferrule is"
            f" {cord.ends[end].lead:.0f} mm outside the mouth. Hold it there with a clip."
        ]
    later_joints = joints_that_stretch(cord)
    if later_joints:
        numbers = sorted(context.step_numbers[j] for j in later_joints)
        steps = join_names([str(n) for n in numbers])
        lines.append(
            f"Until the joint of step {steps} is closed, its opening stretches the cord further:"
            " open the joint like a book, and no wider than you need."
        )
    return lines


def glue_end(context: GuideContext, action: Action) -> list[str]:
    """Instruct to glue an end that no pocket holds."""
    assert action.end is not None
    label = cord_label(context.cord(action).sensor)
    return [
        f"Glue the last 5 mm of {label} into the groove at the mouth of its {ENDS[action.end]}:"
        " no pocket holds this end."
    ]


def let_end_set(_context: GuideContext, _: Action) -> list[str]:
    """Instruct to hold an end until its glue has set."""
    return ["Hold the end until the glue has set."]


def route_wire(context: GuideContext, action: Action) -> list[str]:
    """Instruct to insert a wire into its groove, and where it leads."""
    cord, end = context.cord(action), action.end
    assert end is not None
    wire = cord.ends[end].wire
    line = f"Insert the wire at the {ENDS[end]} of {cord_label(cord.sensor)} into its groove"
    if wire.joints[-1] != action.joint:
        return [f"{line}.", "Let the rest of the wire hang out until a later joint."]
    if wire.leaves == "bend":
        return [
            f"{line}. It leaves the body through the bend next to the mouth, which holds the wire"
            " when it is pulled."
        ]
    hole = ", and push it through the hole at the groove's end" if wire.drop is not None else ""
    return [f"{line}{hole}, into the bay. The wire runs {wire.length:.0f} mm inside the body."]


def glue_joint(context: GuideContext, action: Action) -> list[str]:
    """Instruct to glue and close a joint, and what to do with cords meanwhile."""
    joint, j = context.joint(action), action.joint
    assert j is not None
    lines = [f"Glue the faces of {describe_sides(joint)}."]
    if joint.cords and context.is_bonded:
        lines.append("Glue the cord into its groove along its whole length at the same time.")
    elif joint.cords:
        lines.append("Keep glue out of the grooves: the cord must be able to slide.")
    lines.append("Close the joint, and hold it.")
    for cord in context.manifest.cords:
        lines += [_close_over(cord, j, stretch) for k, stretch in cord.drawn if k == j]
        lines += [_close_over_wire(cord, e) for e in (0, 1) if j in cord.ends[e].wire.crosses]
    wet_until = last_joint_while_wet(context.manifest, j)
    if wet_until is not None:
        lines.append(
            "Continue at once: this glue must still be wet when"
            f" step {context.step_numbers[wet_until]} closes its joint, because the cord must"
            " slide. Use a glue with a long open time."
        )
    return lines


def _close_over(cord: CutCord, j: int, stretch: int) -> str:
    """Say what to do with a cord that passes through a joint while the joint is closed."""
    label = cord_label(cord.sensor)
    if j in joints_that_stretch(cord):
        return (
            f"{capitalize_first(label)} passes through this joint and is held at both ends, so it"
            " pulls the faces together. Do not pinch it between them."
        )
    late = late_end(cord)
    slides = joints_to_slide_in(cord, j, stretch)
    side = 0 if any(s.joint in slides for s in cord.stretches[:stretch]) else 1
    end = side if late is None else late
    return (
        f"While you close the joint, pull {label} towards its {ENDS[end]}, so that no loop stays"
        " between the faces."
    )


def _close_over_wire(cord: CutCord, end: int) -> str:
    """Say what to do with a wire that passes through a joint while the joint is closed."""
    leaves_by_bay = cord.ends[end].wire.leaves == "bay"
    direction = "into the bay" if leaves_by_bay else "out where it leaves the body"
    return (
        f"The wire at the {ENDS[end]} of {cord_label(cord.sensor)} crosses this joint between"
        f" grooves that are already closed. While you close the joint, pull the wire {direction},"
        " so that no loop stays between the faces."
    )


def let_joint_set(_context: GuideContext, _: Action) -> list[str]:
    """Instruct to wait until the glue of a joint has set."""
    return ["Let the glue set for the time on its package."]
