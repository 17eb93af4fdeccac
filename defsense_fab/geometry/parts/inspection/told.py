"""What a maker should know of parts and joints, by their names."""

from __future__ import annotations

from ...kernels import triangle_kernel
from ...printing.print_bed import FOOTHOLD, footing
from ..records import Made


def of_part(made: Made, i: int, piece: bool = False) -> list[str]:
    """Of the part of this index, or the `piece` of one that was cut across: how it stands on the
    bed, and whether it has its number."""
    part, out = made.parts[i], []
    if footing(triangle_kernel.to_manifold(part.surface, part.name), part.down) < FOOTHOLD:
        out.append(f"{part.name} has no flat face to stand on: print it with a brim and supports")
    if len(made.parts) > 1 and i not in {m.part for m in made.labels}:
        why = "has no number engraved" if piece else "has no face large enough for its number"
        out.append(f"{part.name} {why}: write the number on it")
    return out


def of_joints(made: Made) -> list[str]:
    """Of the joints that too few pins align."""
    out = []
    for k, cut in enumerate(made.cuts):
        fitted = [p for p in made.pins if made.contacts[p.contact].cut == k]
        if len(fitted) < 2:
            a, b = (" + ".join(made.parts[i].name for i in side) for side in cut.sides)
            out.append(
                f"{len(fitted)} of 2 pins fit between {a} and {b}: align the outlines by hand while"
                " the glue sets"
            )
    return out
