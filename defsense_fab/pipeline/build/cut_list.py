"""What to cut and to buy: cords with slack and expected resistance, and the bill of materials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...core.arrays import Float
from ...core.device import Device
from ...geometry.channels.channel_ends import End
from ...geometry.parts.records import Made
from ...sensing.voltage_divider import reference

#: Longer by this much than needed, mm: cords are trimmed when they lie in their grooves.
SLACK = 5.0
#: Length of each wire beyond the body, mm.
OUTSIDE = 200.0


def cut_list(device: Device, made: Made, signals: Float) -> list[dict[str, Any]]:
    """One row a cord; `signals` (n, c) are (R - R0)/R0 in the states that it is to sense.

    A cord ends in the middle of the ferrule that joins it to a wire: in a pocket of the body, or
    outside, behind a free end of `[fabrication] lead` mm. Its resistance counts between the
    ferrules.
    """
    ferrule, lead = device.cord.ferrule_length, device.fabrication.lead
    out = []
    for k, channel in enumerate(made.channels):
        pocketed = [e.pocket > 0 for e in channel.ends]
        sensing = channel.length + sum(-e.pocket if e.pocket else lead for e in channel.ends)
        cut = sensing + ferrule + SLACK
        rest = sensing * device.cord.ohm_per_mm
        low, high = float(signals[:, k].min()), float(signals[:, k].max())
        out.append(
            {
                "sensor": channel.name,
                "cut_length": cut,
                "slack": SLACK,
                "channel_length": channel.length,
                "between_ferrules": sensing,
                "ends": [
                    {
                        "joint": "pocket" if inside else "free",
                        "pocket": e.pocket,
                        "at": e.mouth.tolist(),
                        "lead": 0.0 if inside else lead,
                        **({"why": e.reason} if e.reason else {}),
                        "wire": _wire(e),
                    }
                    for e, inside in zip(channel.ends, pocketed, strict=True)
                ],
                "channel_diameter": device.channel_diameter,
                "resistance": rest,
                "range": [rest * (1 + low), rest * (1 + high)],
                "reference_resistor": reference(rest * (1 + low), rest * (1 + high)),
            }
        )
    return out


def _wire(end: End) -> dict[str, Any]:
    """Where an end's wire leaves the body, and its length and path in it, mm."""
    lead = end.lead
    out: dict[str, Any] = {"leaves": end.wire, "length": lead.length if lead else 0.0}
    if lead:
        out["path"] = lead.path.tolist()
        out["drop"] = None if lead.drop is None else lead.drop.tolist()
    if end.unled:
        out["why"] = end.unled
    return out


def bill(
    device: Device, made: Made, cords: Sequence[Mapping[str, Any]], pins: Mapping[str, int]
) -> list[dict[str, Any]]:
    """Bill of materials: what, how much, and what for."""
    wires = [e["wire"] for c in cords for e in c["ends"]]
    solid = sum(p.volume for p in made.parts) / 1000
    rows: list[dict[str, Any]] = [
        {
            "item": f"{device.material.name}, printed",
            "amount": f"{solid:.0f} cm3",
            "use": f"{len(made.parts)} parts, about {solid * device.material.density:.0f} g if"
            " printed solid, as the prediction assumes",
        },
        {
            "item": f"cord {device.cord.name}, {device.cord.diameter:g} mm",
            "amount": f"{sum(c['cut_length'] for c in cords):.0f} mm",
            "use": f"{len(cords)} pieces, see the cut list",
        },
        {
            "item": f"ferrule, {device.cord.ferrule_diameter:g} mm outside,"
            f" {device.cord.ferrule_length:g} mm long",
            "amount": str(2 * len(cords)),
            "use": "crimped onto cord and wire at both ends of every cord",
        },
        {
            "item": f"stranded wire, {device.fabrication.wire_diameter:g} mm outside",
            "amount": f"{sum(w['length'] + OUTSIDE for w in wires):.0f} mm",
            "use": f"{len(wires)} pieces from the ferrules to the read-out, {OUTSIDE:g} mm of each"
            " outside of the body",
        },
    ]
    rows += [
        {"item": f"{name}, printed", "amount": str(count), "use": "loose pins between parts"}
        for name, count in pins.items()
    ]
    for value in sorted({c["reference_resistor"] for c in cords}):
        count = sum(c["reference_resistor"] == value for c in cords)
        rows.append(
            {
                "item": f"resistor {value:g} ohm, 1 %",
                "amount": str(count),
                "use": "reference of the voltage divider of "
                + ", ".join(c["sensor"] for c in cords if c["reference_resistor"] == value),
            }
        )
    if len(made.parts) > 1:
        area = sum(c.area for c in made.contacts) / 100
        rows.append(
            {
                "item": "flexible glue",
                "amount": f"{area:.0f} cm2 of faces",
                "use": f"one that stays as soft as {device.material.name}",
            }
        )
    return rows
