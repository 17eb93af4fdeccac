"""What to cut and to buy: cords with slack and expected resistance, and the bill of materials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...geometry.channels.channel_ends import End
from ...geometry.channels.cord_assembly import JointSides, Stretch, find_late_joints, find_stretches
from ...geometry.channels.cord_channels import Channel
from ...geometry.parts.records import PartSet
from ...optimize.prediction.design_task import TRIM_SLACK_MM
from ...optimize.prediction.predict import ScoredLayout
from ...sensing.built_cord import CordReading
from ...sensing.voltage_divider import choose_reference
from ...store.manifest import BillItem, CordEnd, CordStretch, CutCord, WireRecord

#: Length of each wire beyond the body, mm.
OUTSIDE = 200.0
#: How far a joint is opened for work while a cord passes through it, and what of a cord is held to
#: pull at it, mm.
OPENED, GRIP = 25.0, 10.0


def cut_list(device: Device, made: PartSet, built: ScoredLayout) -> tuple[CutCord, ...]:
    """One row a cord; `built` is what the cords sense as they are built in.

    A cord ends in the middle of the ferrule that joins it to a wire: in a pocket of the body, or
    outside, behind a free end of `[fabrication] lead` mm. Its resistance counts between the
    ferrules. What of that lies outside of the sensing stretch, in the straight runs to the skin and
    in free ends, is a constant resistance in series. A held cord is shorter before it is laid, by
    its pre-stretch.

    A cord that a joint draws together after it was laid on both sides of it (`drawn`) is crimped
    at one end only then, outside of its mouth, where it has an end that this can be done at; its
    piece is longer by what it needs to hang out there while the joint is open.
    """
    ferrule = device.cord.ferrule_length
    joints = _joints(made)
    reading, out = CordReading.from_device(device), []
    for k, (channel, cord, signals) in enumerate(
        zip(made.channels, built.cords, built.signals.T, strict=True)
    ):
        between = cord.length + cord.series
        unstretched = cord.length / (1 + (cord.prestretch or 0.0)) + cord.series
        lies = _lies(channel.inside, channel, device.channel_diameter, made, joints, k)
        lies = held_by(lies, [max(e.pocket - ferrule, 0.0) for e in channel.ends])
        drawn = find_late_joints(lies, joints)
        ends = tuple(_end(e, channel, device, made, joints, k) for e in channel.ends)
        late, after = last_end(lies, drawn, ends)
        slack = TRIM_SLACK_MM
        if late is not None:
            ends = tuple(replace(e, after=after) if n == late else e for n, e in enumerate(ends))
            out_of_mouth = ends[late].pocket - ferrule / 2 if ends[late].pocket else 0.0
            reach = between - unstretched + out_of_mouth + OPENED + GRIP
            slack = max(TRIM_SLACK_MM, float(np.ceil(reach - ferrule / 2)))
        rest = reading.resistance(cord)
        low, high = (rest * (1 + float(s)) for s in (signals.min(), signals.max()))
        out.append(
            CutCord(
                sensor=channel.name,
                cut_length=unstretched + ferrule + slack,
                slack=slack,
                channel_length=channel.length,
                between_ferrules=between,
                unstretched=unstretched,
                prestretch=cord.prestretch,
                sensing_length=cord.length,
                ends=(ends[0], ends[1]),
                channel_diameter=device.channel_diameter,
                resistance_before=unstretched * device.cord.ohm_per_mm,
                resistance=rest,
                range=(low, high),
                reference_resistor=choose_reference(low, high),
                stretches=tuple(CordStretch(s.joint, s.start, s.stop) for s in lies),
                drawn=tuple(drawn),
            )
        )
    return tuple(out)


def behind(cords: Sequence[CutCord], joints: int) -> tuple[CutCord, ...]:
    """The same rows where so many joints are closed before all that the cords lie in."""

    def ended(end: CordEnd) -> CordEnd:
        wire = replace(
            end.wire,
            joints=tuple(j + joints for j in end.wire.joints),
            crosses=tuple(j + joints for j in end.wire.crosses),
        )
        return replace(end, wire=wire, after=None if end.after is None else end.after + joints)

    return tuple(
        replace(
            cord,
            ends=(ended(cord.ends[0]), ended(cord.ends[1])),
            stretches=tuple(replace(s, joint=s.joint + joints) for s in cord.stretches),
            drawn=tuple((j + joints, at) for j, at in cord.drawn),
        )
        for cord in cords
    )


def _joints(made: PartSet) -> list[JointSides]:
    """What each joint brings together, in the order of assembly: the cuts backwards."""
    return [(frozenset(c.sides[0]), frozenset(c.sides[1])) for c in reversed(made.cuts)]


def _lies(
    line: Float,
    channel: Channel,
    diameter: float,
    made: PartSet,
    joints: Sequence[JointSides],
    cord: int,
) -> tuple[Stretch, ...]:
    """The joints that a line of the channel's plane lies in, if any."""
    within = [j for j, c in enumerate(reversed(made.cuts)) if cord in c.cords]
    if not within:
        return ()
    normal = channel.sensor.plane.normal
    parts = [p.surface for p in made.parts]
    return find_stretches(line, normal, diameter / 2, parts, joints, within)


def held_by(lies: Sequence[Stretch], empty: Sequence[float]) -> tuple[Stretch, ...]:
    """The stretches that a cord's ferrules reach, up to its mouths: behind a ferrule, at either end
    so many mm are `empty` but for the wire that leaves by a bend."""
    out = list(lies)
    while len(out) > 1 and out[0].stop <= empty[0]:
        out[:2] = [replace(out[1], start=out[0].start)]
    while len(out) > 1 and out[-1].stop - out[-1].start <= empty[1]:
        out[-2:] = [replace(out[-2], stop=out[-1].stop)]
    return tuple(out)


def last_end(
    lies: Sequence[Stretch], drawn: Sequence[tuple[int, int]], ends: Sequence[CordEnd]
) -> tuple[int | None, int | None]:
    """The end that is crimped last, and after which joint, where both ends would hold the cord
    while a joint is still to draw it together. A wire that is laid beside its pocket must be
    crimped before: such an end cannot be the last."""
    held = [j for j, _ in drawn if max(lies[0].joint, lies[-1].joint) < j]
    able = [k for k, e in enumerate(ends) if e.wire.leaves in ("mouth", "outside")]
    if not held or not able:
        return None, None
    laid = (lies[0].joint, lies[-1].joint)
    return max(able, key=lambda k: (ends[k].joint == "free", laid[k], k)), max(held)


def _end(
    end: End, channel: Channel, device: Device, made: PartSet, joints: Sequence[JointSides], cord: int
) -> CordEnd:
    inside = end.pocket > 0
    return CordEnd(
        joint="pocket" if inside else "free",
        pocket=end.pocket,
        at=end.mouth,
        lead=0.0 if inside else device.fabrication.lead,
        wire=_wire(end, channel, device, made, joints, cord),
        why=end.reason or None,
    )


def _wire(
    end: End, channel: Channel, device: Device, made: PartSet, joints: Sequence[JointSides], cord: int
) -> WireRecord:
    lead, why = end.lead, end.unled or None
    if lead is None:
        return WireRecord(end.wire, 0.0, why=why)
    thick = device.fabrication.wire_diameter + device.fabrication.clearance
    lies = _lies(lead.inside, channel, thick, made, joints, cord)
    order = tuple(dict.fromkeys(s.joint for s in lies))
    crosses = tuple(sorted({j for j, _ in find_late_joints(lies, joints)}))
    return WireRecord(end.wire, lead.length, lead.path, lead.drop, why, order, crosses)


def bill(
    device: Device, made: PartSet, cords: Sequence[CutCord], pins: Mapping[str, int]
) -> tuple[BillItem, ...]:
    """Bill of materials of all copies: what, how much, and what for; `pins` of one device."""
    copies = device.fabrication.copies
    of = f" for {copies} devices" if copies > 1 else ""
    wires = [e.wire for c in cords for e in c.ends]
    solid = copies * sum(p.volume for p in made.parts) / 1000
    rows = [
        BillItem(
            f"{device.material.name}, printed",
            f"{solid:.0f} cm3",
            f"{copies * len(made.parts)} parts{of}, about {solid * device.material.density:.0f} g"
            " if printed solid, as the prediction assumes",
        ),
        BillItem(
            f"cord {device.cord.name}, {device.cord.diameter:g} mm",
            f"{copies * sum(c.cut_length for c in cords):.0f} mm",
            f"{copies * len(cords)} piece{'s' * (copies * len(cords) > 1)}{of}, see the cut list",
        ),
        BillItem(
            f"ferrule, {device.cord.ferrule_diameter:g} mm outside,"
            f" {device.cord.ferrule_length:g} mm long",
            str(2 * copies * len(cords)),
            "crimped onto cord and wire at both ends of every cord",
        ),
        BillItem(
            f"stranded wire, {device.fabrication.wire_diameter:g} mm outside",
            f"{copies * sum(w.length + OUTSIDE for w in wires):.0f} mm",
            f"{copies * len(wires)} pieces from the ferrules to the read-out, {OUTSIDE:g} mm of"
            " each outside of the body",
        ),
    ]
    rows += [
        BillItem(f"{name}, printed", str(copies * count), "loose pins between parts")
        for name, count in pins.items()
    ]
    for value in sorted({c.reference_resistor for c in cords}):
        count = sum(c.reference_resistor == value for c in cords)
        rows.append(
            BillItem(
                f"resistor {value:g} ohm, 1 %",
                str(copies * count),
                "reference of the voltage divider of "
                + ", ".join(c.sensor for c in cords if c.reference_resistor == value),
            )
        )
    if len(made.parts) > 1:
        area = copies * sum(c.area for c in made.contacts) / 100
        rows.append(
            BillItem(
                "silicone glue" if device.fabrication.kind == "cast" else "flexible glue",
                f"{area:.0f} cm2 of faces",
                f"the silicone itself, or a glue for cured {device.material.name}: others do not"
                " hold on it"
                if device.fabrication.kind == "cast"
                else f"one that stays as soft as {device.material.name}",
            )
        )
    return tuple(rows)
