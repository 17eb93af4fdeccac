"""Cords that a joint stretches while it is open, because they are laid into several joints that are
closed one after the other: how short they may be, and which of a layout are too short."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.device.device import Device
from ...geometry.channels import cord_assembly
from ...geometry.parts.records import PartSet
from ...sensing.built_cord import BuiltCord

#: How far a joint is opened at least for work in it, mm.
LEAST_OPEN = 15.0
#: As much as most held cords are stretched by as they are laid, where that is not known yet;
#: `overstretched` tells of those that are stretched by more.
_PRESTRETCH = 0.1


def least_across(device: Device) -> float:
    """The length between ferrules, mm, from which on a cord takes an open joint that it passes
    through, held at both ends."""
    f = device.fabrication
    given = _PRESTRETCH if f.prestretch is None else f.prestretch
    laid = 0.0 if f.assembly == "bonded" else given
    spare = device.cord.max_strain - laid
    return (1 + laid) * LEAST_OPEN / spare if spare > 0 else float("inf")


def overstretched(device: Device, made: PartSet, cords: Sequence[BuiltCord]) -> list[str]:
    """What is to be said of cords, as they are built in, that are stretched beyond their limit by
    a joint that is still open, or as an end is crimped outside of its mouth that has to wait for
    that. Raises nothing."""
    most, ferrule = device.cord.max_strain, device.cord.ferrule_length
    out = []
    for k, (channel, cord) in enumerate(zip(made.channels, cords, strict=True)):
        if sum(k in c.cords and k not in c.wires for c in made.cuts) < 2:
            continue
        between = cord.length + cord.series
        loose = cord.length / (1 + (cord.prestretch or 0.0)) + cord.series
        lead = device.fabrication.lead
        waiting = [
            cord_assembly.crimping_strain(between, loose, e.pocket, ferrule, 0.0 if e.pocket else lead)
            for e in channel.ends
            if e.wire in ("mouth", "outside")
        ]
        strain = min(waiting, default=(between + LEAST_OPEN) / loose - 1)
        if strain > most:
            out.append(
                f"cord {channel.name} is short and lies in several joints: "
                + (
                    "as its last end is crimped outside of its mouth, it is stretched by"
                    if waiting
                    else f"while one of them is open by {LEAST_OPEN:.0f} mm, it is stretched by"
                )
                + f" {strain:.0%}, more than its {most:.0%}; make it longer, or move its plane or"
                " those that it passes through"
            )
    return out
