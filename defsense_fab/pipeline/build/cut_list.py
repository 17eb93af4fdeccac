"""What to cut and to buy: cords with slack and expected resistance, and the bill of materials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...core.device import Device
from ...geometry.channels.channel_ends import End
from ...geometry.parts.records import Made
from ...sensing.built_cord import CordReading
from ...sensing.voltage_divider import reference
from ..artifacts.manifest import BillItem, CordEnd, CutCord, WireRecord
from ..design.design_task import SLACK
from ..design.predict import Scored

#: Length of each wire beyond the body, mm.
OUTSIDE = 200.0


def cut_list(device: Device, made: Made, built: Scored) -> tuple[CutCord, ...]:
    """One row a cord; `built` is what the cords sense as they are built in.

    A cord ends in the middle of the ferrule that joins it to a wire: in a pocket of the body, or
    outside, behind a free end of `[fabrication] lead` mm. Its resistance counts between the
    ferrules. What of that lies outside of the sensing stretch, in the straight runs to the skin and
    in free ends, is a constant resistance in series. A held cord is shorter before it is laid, by
    its pre-stretch.
    """
    ferrule, lead = device.cord.ferrule_length, device.fabrication.lead
    reading, out = CordReading.of(device), []
    for channel, cord, signals in zip(made.channels, built.cords, built.signals.T, strict=True):
        between = cord.length + cord.series
        unstretched = cord.length / (1 + (cord.prestretch or 0.0)) + cord.series
        cut = unstretched + ferrule + SLACK
        rest = reading.resistance(cord)
        low, high = (rest * (1 + float(s)) for s in (signals.min(), signals.max()))
        out.append(
            CutCord(
                sensor=channel.name,
                cut_length=cut,
                slack=SLACK,
                channel_length=channel.length,
                between_ferrules=between,
                unstretched=unstretched,
                prestretch=cord.prestretch,
                sensing_length=cord.length,
                ends=(_end(channel.ends[0], lead), _end(channel.ends[1], lead)),
                channel_diameter=device.channel_diameter,
                resistance_before=unstretched * device.cord.ohm_per_mm,
                resistance=rest,
                range=(low, high),
                reference_resistor=reference(low, high),
            )
        )
    return tuple(out)


def _end(end: End, lead: float) -> CordEnd:
    """`lead`: mm that a free end hangs out."""
    inside = end.pocket > 0
    return CordEnd(
        joint="pocket" if inside else "free",
        pocket=end.pocket,
        at=end.mouth,
        lead=0.0 if inside else lead,
        wire=_wire(end),
        why=end.reason or None,
    )


def _wire(end: End) -> WireRecord:
    lead, why = end.lead, end.unled or None
    if lead is None:
        return WireRecord(end.wire, 0.0, why=why)
    return WireRecord(end.wire, lead.length, lead.path, lead.drop, why)


def bill(
    device: Device, made: Made, cords: Sequence[CutCord], pins: Mapping[str, int]
) -> tuple[BillItem, ...]:
    """Bill of materials: what, how much, and what for."""
    wires = [e.wire for c in cords for e in c.ends]
    solid = sum(p.volume for p in made.parts) / 1000
    rows = [
        BillItem(
            f"{device.material.name}, printed",
            f"{solid:.0f} cm3",
            f"{len(made.parts)} parts, about {solid * device.material.density:.0f} g if"
            " printed solid, as the prediction assumes",
        ),
        BillItem(
            f"cord {device.cord.name}, {device.cord.diameter:g} mm",
            f"{sum(c.cut_length for c in cords):.0f} mm",
            f"{len(cords)} pieces, see the cut list",
        ),
        BillItem(
            f"ferrule, {device.cord.ferrule_diameter:g} mm outside,"
            f" {device.cord.ferrule_length:g} mm long",
            str(2 * len(cords)),
            "crimped onto cord and wire at both ends of every cord",
        ),
        BillItem(
            f"stranded wire, {device.fabrication.wire_diameter:g} mm outside",
            f"{sum(w.length + OUTSIDE for w in wires):.0f} mm",
            f"{len(wires)} pieces from the ferrules to the read-out, {OUTSIDE:g} mm of each"
            " outside of the body",
        ),
    ]
    rows += [
        BillItem(f"{name}, printed", str(count), "loose pins between parts")
        for name, count in pins.items()
    ]
    for value in sorted({c.reference_resistor for c in cords}):
        count = sum(c.reference_resistor == value for c in cords)
        rows.append(
            BillItem(
                f"resistor {value:g} ohm, 1 %",
                str(count),
                "reference of the voltage divider of "
                + ", ".join(c.sensor for c in cords if c.reference_resistor == value),
            )
        )
    if len(made.parts) > 1:
        area = sum(c.area for c in made.contacts) / 100
        rows.append(
            BillItem(
                "flexible glue",
                f"{area:.0f} cm2 of faces",
                f"one that stays as soft as {device.material.name}",
            )
        )
    return tuple(rows)
