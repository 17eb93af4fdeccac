"""Compute the cut list and the bill of materials: cords with slack and expected resistance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil

import numpy as np

from ...core.arrays import Float
from ...core.device.boards import ADS1115, ADS1115_INPUTS, find_board
from ...core.device.device import Device
from ...core.device.glues import find_glue, find_slow_glue
from ...geometry.channels.channel_ends import End
from ...geometry.channels.cord_assembly import JointSides, Stretch, find_late_joints, find_stretches
from ...geometry.channels.cord_channels import Channel
from ...geometry.parts.records import PartSet
from ...optimization.prediction.design_task import TRIM_SLACK_MM
from ...optimization.prediction.predict import ScoredLayout
from ...sensing.built_cord import CordReading
from ...sensing.voltage_divider import choose_reference
from ...store.manifest import BillItem, CordEnd, CutCord, JointStretch, WireRecord
from ..fabrication.effort import spare_length
from ..fabrication.print_time import pin_volume
from ..fabrication.printing import pin_name

_WIRE_LENGTH_OUTSIDE_MM = 200.0
_JOINT_OPENING_MM = 25.0  # for work while a cord passes through the joint
_GRIP_LENGTH_MM = 10.0  # of a cord, to pull it


def cut_list(device: Device, part_set: PartSet, built: ScoredLayout) -> tuple[CutCord, ...]:
    """Return one row of the cut list for each cord.

    A cord ends in the middle of the ferrule that joins it to a wire: in a pocket of the body, or
    outside, behind a free end of `[fabrication] lead` mm. Its resistance counts between the
    ferrules. Outside the sensing stretch, in the straight runs to the skin and in free ends, the
    cord is a constant resistance in series. A held cord is shorter before it is inserted, by its
    prestretch.

    Some joints draw a cord together after it was inserted on both sides of them (`drawn`). Such a
    cord is crimped at one end only after that, outside its mouth, if it has a suitable end. Its
    piece is longer by the length that hangs out while the joint is open.

    Args:
        device: The device.
        part_set: Its parts.
        built: What the cords sense as they are built in.

    Returns:
        The rows, in the order of the channels.
    """
    ferrule = device.cord.ferrule_length
    joints = _joint_sides(part_set)
    reading, rows = CordReading.from_device(device), []
    for k, (channel, cord, signals) in enumerate(
        zip(part_set.channels, built.cords, built.signals.T, strict=True)
    ):
        between_ferrules = cord.length + cord.series
        unstretched = cord.length / (1 + (cord.prestretch or 0.0)) + cord.series
        stretches = _find_stretches_in(
            channel.inside, channel, device.channel_diameter, part_set, joints, k
        )
        stretches = held_by(stretches, [max(e.pocket - ferrule, 0.0) for e in channel.ends])
        drawn = find_late_joints(stretches, joints)
        ends = tuple(_end_record(e, channel, device, part_set, joints, k) for e in channel.ends)
        late, after = last_end(stretches, drawn, ends)
        slack = TRIM_SLACK_MM
        if late is not None:
            ends = tuple(replace(e, after=after) if n == late else e for n, e in enumerate(ends))
            out_of_mouth = ends[late].pocket - ferrule / 2 if ends[late].pocket else 0.0
            reach = (
                between_ferrules - unstretched + out_of_mouth + _JOINT_OPENING_MM + _GRIP_LENGTH_MM
            )
            slack = max(TRIM_SLACK_MM, float(np.ceil(reach - ferrule / 2)))
        rest = reading.resistance(cord)
        low, high = (rest * (1 + float(s)) for s in (signals.min(), signals.max()))
        rows.append(
            CutCord(
                sensor=channel.name,
                cut_length=unstretched + ferrule + slack,
                slack=slack,
                channel_length=channel.length,
                between_ferrules=between_ferrules,
                unstretched=unstretched,
                prestretch=cord.prestretch,
                sensing_length=cord.length,
                ends=(ends[0], ends[1]),
                channel_diameter=device.channel_diameter,
                resistance_before=unstretched * device.cord.ohm_per_mm,
                resistance=rest,
                range=(low, high),
                reference_resistor=choose_reference(low, high),
                stretches=_recorded(stretches),
                drawn=tuple(drawn),
            )
        )
    return tuple(rows)


def behind(cords: Sequence[CutCord], joints: int) -> tuple[CutCord, ...]:
    """Return the cut list if `joints` further joints are closed before all joints of the cords."""

    def ended(end: CordEnd) -> CordEnd:
        wire = replace(
            end.wire,
            stretches=tuple(replace(s, joint=s.joint + joints) for s in end.wire.stretches),
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


def _joint_sides(part_set: PartSet) -> list[JointSides]:
    """Return the parts on both sides of each joint, in the order of assembly."""
    # Parts are joined in the reverse order of the cuts.
    return [(frozenset(c.sides[0]), frozenset(c.sides[1])) for c in reversed(part_set.cuts)]


def _find_stretches_in(
    line: Float,
    channel: Channel,
    diameter: float,
    part_set: PartSet,
    joints: Sequence[JointSides],
    cord: int,
) -> tuple[Stretch, ...]:
    """Return the joints in which a line in the channel's plane lies."""
    joints_of_cord = [j for j, c in enumerate(reversed(part_set.cuts)) if cord in c.cords]
    if not joints_of_cord:
        return ()
    normal = channel.sensor.plane.normal
    parts = [p.surface for p in part_set.parts]
    return find_stretches(line, normal, diameter / 2, parts, joints, joints_of_cord)


def held_by(stretches: Sequence[Stretch], empty: Sequence[float]) -> tuple[Stretch, ...]:
    """Return the stretches that a cord's ferrules reach, extended to its mouths.

    Args:
        stretches: Stretches of the cord.
        empty: Length at each end that only a wire fills, behind the ferrule, mm.
    """
    held = list(stretches)
    while len(held) > 1 and held[0].stop <= empty[0]:
        held[:2] = [replace(held[1], start=held[0].start)]
    while len(held) > 1 and held[-1].stop - held[-1].start <= empty[1]:
        held[-2:] = [replace(held[-2], stop=held[-1].stop)]
    return tuple(held)


def last_end(
    stretches: Sequence[Stretch], drawn: Sequence[tuple[int, int]], ends: Sequence[CordEnd]
) -> tuple[int | None, int | None]:
    """Return the end that is crimped last, and the joint after which it is crimped.

    An end is crimped last if both ends would hold the cord while a joint still draws it together. A
    wire in a groove next to its pocket must be crimped earlier, so its end cannot be the last.

    Args:
        stretches: Stretches of the cord.
        drawn: Joints that draw the cord together, each with the index of the stretch behind it.
        ends: Ends of the cord.

    Returns:
        The end and the joint, or None and None.
    """
    later_joints = [j for j, _ in drawn if max(stretches[0].joint, stretches[-1].joint) < j]
    candidates = [k for k, e in enumerate(ends) if e.wire.leaves in ("mouth", "outside")]
    if not later_joints or not candidates:
        return None, None
    end_joints = (stretches[0].joint, stretches[-1].joint)
    return max(candidates, key=lambda k: (ends[k].joint == "free", end_joints[k], k)), max(
        later_joints
    )


def _end_record(
    end: End,
    channel: Channel,
    device: Device,
    part_set: PartSet,
    joints: Sequence[JointSides],
    cord: int,
) -> CordEnd:
    has_pocket = end.pocket > 0
    return CordEnd(
        joint="pocket" if has_pocket else "free",
        pocket=end.pocket,
        at=end.mouth,
        lead=0.0 if has_pocket else device.fabrication.lead,
        wire=_wire_record(end, channel, device, part_set, joints, cord),
        why=end.reason or None,
    )


def _wire_record(
    end: End,
    channel: Channel,
    device: Device,
    part_set: PartSet,
    joints: Sequence[JointSides],
    cord: int,
) -> WireRecord:
    lead, why = end.lead, end.unled or None
    if lead is None:
        return WireRecord(end.wire, 0.0, why=why)
    width = device.fabrication.wire_diameter + device.fabrication.clearance
    stretches = _find_stretches_in(lead.inside, channel, width, part_set, joints, cord)
    crosses = tuple(sorted({j for j, _ in find_late_joints(stretches, joints)}))
    recorded = _recorded(stretches)
    return WireRecord(end.wire, lead.length, lead.path, lead.drop, why, recorded, crosses)


def _recorded(stretches: Sequence[Stretch]) -> tuple[JointStretch, ...]:
    return tuple(JointStretch(s.joint, s.start, s.stop) for s in stretches)


def bill(
    device: Device, part_set: PartSet, cords: Sequence[CutCord], pins: Mapping[str, int]
) -> tuple[BillItem, ...]:
    """Return the bill of materials of all copies.

    Args:
        device: The device.
        part_set: Its parts.
        cords: The cut list.
        pins: Number of pins of each kind in one device.

    Returns:
        Items with amount and use.
    """
    copies = device.fabrication.copies
    if part_set.traces:
        return _trace_bill(device, part_set, cords)
    for_copies = f" for {copies} devices" if copies > 1 else ""
    wires = [e.wire for c in cords for e in c.ends]
    volume_cm3 = copies * sum(p.volume for p in part_set.parts) / 1000
    mass_g = volume_cm3 * device.material.density
    cord_mm = copies * sum(c.cut_length for c in cords)
    spare_mm = copies * spare_length(cords)
    wire_mm = copies * sum(w.length + _WIRE_LENGTH_OUTSIDE_MM for w in wires)
    rows = [
        BillItem(
            f"{device.material.name}, printed",
            f"{volume_cm3:.0f} cm3",
            f"{copies * len(part_set.parts)} parts{for_copies}, about {mass_g:.0f} g if printed"
            " solid, as the prediction assumes",
            "filament",
            mass_g / 1000,
        ),
        BillItem(
            f"cord {device.cord.name}, {device.cord.diameter:g} mm",
            f"{cord_mm:.0f} mm",
            f"{copies * len(cords)} piece{'s' * (copies * len(cords) > 1)}{for_copies}, see the"
            f" cut list; buy {spare_mm:.0f} mm more, to replace a piece whose crimp fails",
            "cord",
            (cord_mm + spare_mm) / 1000,
        ),
        BillItem(
            f"ferrule, {device.cord.ferrule_diameter:g} mm outside,"
            f" {device.cord.ferrule_length:g} mm long",
            str(2 * copies * len(cords)),
            "crimped onto cord and wire at both ends of every cord",
            "ferrule",
            2 * copies * len(cords),
        ),
        BillItem(
            f"stranded wire, {device.fabrication.wire_diameter:g} mm outside",
            f"{wire_mm:.0f} mm",
            f"{copies * len(wires)} pieces from the ferrules to the read-out, with"
            f" {_WIRE_LENGTH_OUTSIDE_MM:g} mm of each outside the body",
            "wire",
            wire_mm / 1000,
        ),
    ]
    rows += [_pin_item(device, part_set, name, count) for name, count in pins.items()]
    for value in sorted({c.reference_resistor for c in cords}):
        names = [c.sensor for c in cords if c.reference_resistor == value]
        rows.append(
            BillItem(
                f"resistor {value:g} ohm, 1 %",
                str(copies * len(names)),
                f"reference of the voltage divider of {', '.join(names)}",
                "resistor",
                copies * len(names),
            )
        )
    rows += _read_out(device, len(cords))
    if len(part_set.parts) > 1 or any(e.joint == "free" for c in cords for e in c.ends):
        rows.append(_glue_item(device, copies * sum(c.area for c in part_set.contacts)))
    return tuple(rows)


def _pin_item(device: Device, part_set: PartSet, name: str, count: int) -> BillItem:
    """Return the item of a kind of pin; those of moulds are of another material than the parts."""
    f, use = device.fabrication, "loose pins between parts"
    pins = [p for p in part_set.pins if pin_name(p) == name]
    if f.kind == "cast" or not pins:
        return BillItem(f"{name}, printed", str(f.copies * count), use)
    volume_cm3 = f.copies * count * pin_volume(pins[0].diameter, pins[0].length) / 1000
    mass_kg = volume_cm3 * device.material.density / 1000
    return BillItem(f"{name}, printed", str(f.copies * count), use, "filament", mass_kg)


def _trace_bill(
    device: Device, part_set: PartSet, cords: Sequence[CutCord]
) -> tuple[BillItem, ...]:
    """Return the bill of materials of a body with printed traces."""
    copies, spec = device.fabrication.copies, device.cord.trace
    assert spec is not None
    assert device.pad is not None
    body = copies * sum(p.volume for p in part_set.parts) / 1000
    traces = copies * sum(t.volume for t in part_set.traces) / 1000
    mass = body * device.material.density
    return (
        BillItem(
            f"{device.material.name}, extruder 1",
            f"{body:.0f} cm3",
            f"about {mass:.0f} g",
            "filament",
            mass / 1000,
        ),
        BillItem(
            f"{spec.filament}, extruder 2",
            f"{traces:.1f} cm3",
            f"{copies * len(cords)} traces; purging takes several times as much",
        ),
        BillItem(
            device.pad.needs,
            str(2 * copies * len(cords)),
            "one for each pad",
        ),
        *(
            BillItem(
                f"resistor {c.reference_resistor:g} ohm, 1 %",
                str(copies),
                f"reference of the voltage divider of {c.sensor}",
                "resistor",
                copies,
            )
            for c in cords
        ),
        *_read_out(device, len(cords)),
    )


def _read_out(device: Device, cords: int) -> list[BillItem]:
    """Return the boards that read a number of cords, and the converters on modules."""
    board, copies = find_board(device.board), device.fabrication.copies
    use = f"reads the {device.cord.noun}s; the package has its program"
    items = [BillItem(board.title, str(copies), use, "board", copies)]
    if device.converter == ADS1115:
        modules = copies * ceil(cords / ADS1115_INPUTS)
        items.append(
            BillItem("ADS1115 module", str(modules), "its converters", "converter", modules)
        )
    return items


def _glue_item(device: Device, area_mm2: float) -> BillItem:
    """Return the glue for the faces of the joints, or for ends of cords alone."""
    glue, slow_glue = find_glue(device), find_slow_glue(device)
    use = "joins the parts" if area_mm2 else "holds ends of cords that have no pocket"
    use = f"{use}; {glue.example}, for example"
    if area_mm2 and slow_glue is not None:
        use += f"; for large faces {slow_glue.kind}, such as {slow_glue.example}"
    return BillItem(
        f"glue: {glue.kind}",
        f"{area_mm2 / 100:.0f} cm2 of faces" if area_mm2 else "some drops",
        use,
        "glue",
        area_mm2 / 1e4,
    )
