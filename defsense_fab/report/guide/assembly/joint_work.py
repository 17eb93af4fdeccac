"""What the guide says of what is done at an open joint."""

from __future__ import annotations

from ....store.manifest import CutCord
from .actions import Action
from .plan import anchored_later, joint_of, sliding, strained, wet_until
from .wording import ENDS, Words, called, first, named, pin_letters, sides


def dry_fit(w: Words, action: Action) -> list[str]:
    """Without glue, and apart again."""
    return [
        f"Put {sides(w.step(action))} together dry"
        + (", with their pins" if w.step(action).pins else "")
        + ": the faces meet all around. Take them apart again."
    ]


def pins(w: Words, action: Action) -> list[str]:
    """Which pin goes where."""
    step = w.step(action)
    kinds = {p.name: p for p in w.manifest.pins}
    out = ["Put the pins into the sockets of one side, by their letters in the picture."]
    pairs = dict.fromkeys(p.between for p in step.pins)
    for pair in pairs:
        some = [
            (letter, kinds[p.name])
            for letter, p in zip(pin_letters(step), step.pins, strict=True)
            if p.between == pair
        ]
        wide = [k.diameter for _, k in some]
        told = []
        for letter, kind in some:
            which = {max(wide): "the thicker, ", min(wide): "the thinner, "}.get(kind.diameter, "")
            which = which if len(set(wide)) > 1 else ""
            told.append(f"{letter}: {which}{kind.diameter:g} mm thick, {kind.length:.1f} mm long")
        out.append(f"Between {named(pair)}: {'; '.join(told)}.")
    return out


def lay(w: Words, action: Action) -> list[str]:
    """A stretch of a cord, with the ends that it has."""
    cord, j = w.cord(action), action.joint
    many = len(cord.stretches) > 1
    if many:
        here = [s for s in cord.stretches if s.joint == j]
        last = all(s.joint <= (j or 0) for s in cord.stretches)
        ranges = named([f"from {s.start:.0f} to {s.stop:.0f}" for s in here])
        out = (
            f"Lay {called(cord.sensor)} into its groove {ranges} mm of its"
            f" {cord.channel_length:.0f} mm, counted from its start"
            + (" (the rest is laid already)" if last else "")
        )
    else:
        out = f"Lay {called(cord.sensor)} into its groove"
    ends = [_end_said(cord, e) for e in (0, 1) if joint_of(cord, e) == j]
    out += f": {', '.join(ends)}." if ends else "."
    if any(s.joint > (j or 0) for s in cord.stretches):
        out += " The rest hangs out until a later joint."
    lines = [out]
    if not cord.prestretch and j == max(s.joint for s in cord.stretches):
        lines.append(f"{first(called(cord.sensor))} lies in its groove without being stretched.")
    return lines


def _end_said(cord: CutCord, end: int) -> str:
    what, record = ENDS[end], cord.ends[end]
    if record.after is not None:
        return f"its {what}, without a ferrule, hangs out of the mouth"
    if record.joint == "pocket":
        return f"the ferrule of its {what} in its pocket"
    return f"its {what} out of the mouth, the middle of the ferrule {record.lead:.0f} mm beyond it"


def stretch(w: Words, action: Action) -> list[str]:
    """By how much, and what holds it."""
    cord = w.cord(action)
    pull = cord.between_ferrules - cord.unstretched
    out = f"Stretch {called(cord.sensor)} by {pull:.1f} mm ({cord.prestretch or 0:.0%})"
    free = [ENDS[k] for k, e in enumerate(cord.ends) if e.joint == "free"]
    if not free:
        out += ", so that both ferrules rest against the bottoms of their pockets, which hold it."
    else:
        out += (
            f" from its {free[-1]}: the middle of the ferrule is then"
            f" {cord.ends[ENDS.index(free[-1])].lead:.0f} mm out of the mouth. Hold it so with a"
            " clip."
        )
    later = strained(cord)
    if later:
        out += (
            f" Until the joint of step"
            f" {named([str(n) for n in sorted(w.numbers[j] for j in later)])} is closed, it is"
            " stretched by as much more as that is open: open it like a book, and no further than"
            " you need."
        )
    return [out]


def glue_end(w: Words, action: Action) -> list[str]:
    """An end that no pocket holds."""
    assert action.end is not None
    return [
        f"No pocket holds the {ENDS[action.end]} of {called(w.cord(action).sensor)}: glue its last"
        " 5 mm into the groove at the mouth."
    ]


def set_end(_w: Words, _: Action) -> list[str]:
    """Until the glue holds that end."""
    return ["Let that set before you let go."]


def wire(w: Words, action: Action) -> list[str]:
    """A wire's groove, and where it leads."""
    cord, end = w.cord(action), action.end
    assert end is not None
    wire, j = cord.ends[end].wire, action.joint
    what = f"Lay the wire at the {ENDS[end]} of {called(cord.sensor)} into its groove"
    goes_on = wire.joints[-1] != j
    if goes_on:
        return [f"{what}; the rest of it hangs out until a later joint."]
    if wire.leaves == "bend":
        return [
            f"{what}: it leaves by the bend beside the mouth, which holds it when it is pulled."
        ]
    hole = " and push it through the hole at its end" if wire.drop is not None else ""
    return [f"{what}{hole}, into the bay: {wire.length:.0f} mm in all."]


def glue(w: Words, action: Action) -> list[str]:
    """The faces, and what cords do meanwhile."""
    step, j = w.step(action), action.joint
    out = f"Glue the faces of {sides(step)}"
    if step.cords and w.bonded:
        out += ", and with them the cord into its groove all along"
    elif step.cords:
        out += "; keep glue out of the grooves: the cord must slide"
    lines = [f"{out}. Close the joint, and hold it."]
    assert j is not None
    for cord in w.manifest.cords:
        for joint, at in cord.drawn:
            if joint == j:
                lines.append(_drawn(cord, j, at))
        lines += [_crossing(cord, end) for end in (0, 1) if j in cord.ends[end].wire.crosses]
    wet = wet_until(w.manifest, j)
    if wet is not None:
        lines.append(
            f"Go on at once: this glue must still be wet when step {w.numbers[wet]} closes its"
            " joint, for the cord has to slide. Take a glue with a long open time."
        )
    return lines


def _drawn(cord: CutCord, j: int, at: int) -> str:
    if j in strained(cord):
        return (
            f"{first(called(cord.sensor))} passes through this joint, held at both ends: it pulls"
            " the faces together. See that it is not pinched between them."
        )
    late = anchored_later(cord)
    slides = sliding(cord, j, at)
    side = 0 if any(s.joint in slides for s in cord.stretches[:at]) else 1
    end = side if late is None else late
    return (
        f"As you close it, pull {called(cord.sensor)} towards its {ENDS[end]}, so that no loop of"
        " it stays between the faces."
    )


def _crossing(cord: CutCord, end: int) -> str:
    out = "into the bay" if cord.ends[end].wire.leaves == "bay" else "out where it leaves the body"
    return (
        f"The wire at the {ENDS[end]} of {called(cord.sensor)} crosses this joint, between grooves"
        f" that are closed already: as you close it, pull the wire {out}, so that no loop of it"
        " stays between the faces."
    )


def set_glue(_w: Words, _: Action) -> list[str]:
    """Until the glue holds the joint."""
    return ["Let the glue set as long as it says."]
