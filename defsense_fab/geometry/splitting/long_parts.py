"""Parts too long for the bed are cut across, and joined by two dowels before all else.

The cut is planar and across the part as it lies on the bed. It keeps away from pins, from the ends
of cords with their pockets, and from numbers; a channel that it crosses goes on straight behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..parts.check import Check
from ..parts.inspection.conservation import apart, volumes
from ..parts.inspection.insertion import insertion
from ..parts.inspection.thin_places import thin_places
from ..parts.records import Made, Part, Rules
from ..printing.print_bed import fits, laid
from .cut_places import SHORTEST, cut_heights, long_way, reach
from .dowelled_cut import DowelledCut, cut_across
from .inspection import one_solid
from .renumbering import lettered

#: Pieces beyond which a part is not cut up.
MOST = 6


@dataclass(frozen=True)
class Split:
    """The parts with those that were too long in pieces, their checks those of the pieces, and what
    a maker is told of it."""

    made: Made
    notes: tuple[str, ...]


def split_long(made: Made, bed: tuple[float, float, float], rules: Rules) -> Split:
    """Cut every part across that the bed (x, y, z, mm) does not hold, as often as it needs.

    Raises FabricationError, with sizes, for a part that no such cut helps, and for pieces that fail
    a check.
    """
    notes: list[str] = []
    checks: list[Check] = []
    split: list[str] = []
    pieces: list[int] = []
    index = 0
    while index < len(made.parts):
        name, count = made.parts[index].name, 1
        while not _fits(made.parts[index + count - 1], bed):
            if count == MOST:
                raise _too_large(made.parts[index], bed, "it would take more than six pieces")
            done = _cut(made, index + count - 1, bed, rules)
            made = done.made
            checks += done.checks
            notes.append(done.note)
            count += 1
            # The piece that is cut off fits; the rest comes behind it.
        if count > 1:
            made = lettered(made, index, count, name)
            notes = [n.replace("{pieces}", _letters(name, count)) for n in notes]
            split.append(name)
            pieces += range(index, index + count)
        index += count
    return Split(_inspected(made, split, pieces, checks, rules) if split else made, tuple(notes))


def _inspected(
    made: Made, split: Sequence[str], pieces: Sequence[int], checks: Sequence[Check], rules: Rules
) -> Made:
    """With what is measured of all parts now in place of what it was before the cuts, and of the
    `pieces` (indices) in place of the `split` parts (names)."""
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in made.parts]
    found = [
        volumes(made),
        apart(made),
        insertion(made, solids, rules),
        *thin_places(made, solids, pieces, rules),
        *(one_solid(made.parts[k]) for k in pieces),
        *checks,
    ]
    again = {c.name for c in found}
    gone = [
        c
        for c in made.checks
        if c.name in again or c.name.startswith(tuple(f"{n}: " for n in split))
    ]
    old = {c.note for c in gone}
    return replace(
        made,
        checks=(*(c for c in made.checks if c not in gone), *found),
        warnings=(*(w for w in made.warnings if w not in old), *(c.note for c in found if c.note)),
    )


def _letters(name: str, count: int) -> str:
    return " and ".join(f"{name}-{chr(97 + k)}" for k in range(count))


def _fits(part: Part, bed: tuple[float, float, float]) -> bool:
    return fits(laid(part.surface, part.down), bed)


def _too_large(part: Part, bed: tuple[float, float, float], why: str) -> FabricationError:
    x, y, z = np.ptp(laid(part.surface, part.down).bounds, axis=0)
    return FabricationError(
        f"{part.name} measures {x:.0f} x {y:.0f} x {z:.0f} mm as it is printed, which the bed"
        f" ({bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm) does not hold, and cutting it across does not"
        f" help: {why}; divide it by one more cord plane, make the body smaller, or state another"
        " [fabrication] bed"
    )


def _cut(made: Made, index: int, bed: tuple[float, float, float], rules: Rules) -> DowelledCut:
    """Cut a piece off a part that the bed holds: the longest that leaves about equal ones."""
    part = made.parts[index]
    normal = long_way(part)
    longest = reach(part, normal, bed)
    if longest < 2 * SHORTEST:
        others = sorted(np.ptp(laid(part.surface, part.down).bounds, axis=0))
        raise _too_large(part, bed, f"it is {others[1]:.0f} mm wide and {others[0]:.0f} mm high")
    for height in cut_heights(made, index, normal, longest):
        done = cut_across(made, index, normal, float(height), rules)
        if done is not None:
            return done
    raise _too_large(part, bed, "there is no room for two dowels in any of its sections")
