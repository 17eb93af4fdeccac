"""Parts too long for the bed are cut across, and joined by two dowels before all else.

The cut is planar and across the part as it lies on the bed. It keeps away from pins, from the ends
of cords with their pockets, and from numbers; a channel that it crosses goes on straight behind it.
Where no such cut helps, the part lies on another of its sides, if the bed holds it so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..parts import part_checks
from ..parts.part_checks import apart, insertion, thin_places, volumes
from ..parts.records import Check, PartSet, Part, PartRules
from ..printing.print_bed import fits, laid, other_side
from .cut_places import SHORTEST, cut_heights, long_way, reach
from .dowelled_cut import DowelledCut, cut_across, lettered
from .piece_checks import one_solid

#: Pieces beyond which a part is not cut up.
MOST = 6


@dataclass(frozen=True)
class Split:
    """The parts with those that were too long in pieces or on another side, their checks and
    warnings those of the pieces, and what a maker is told of it."""

    made: PartSet
    notes: tuple[str, ...]


def split_long_parts(made: PartSet, bed: tuple[float, float, float], rules: PartRules) -> Split:
    """Cut every part across that the bed (x, y, z, mm) does not hold, as often as it needs; lay it
    on another side where that does not help.

    Raises FabricationError, with sizes, for a part that neither helps, and for pieces that fail a
    check.
    """
    whole, notes = made, list[str]()
    checks: list[Check] = []
    changed: list[str] = []
    pieces: list[int] = []
    index = 0
    while index < len(made.parts):
        part, count = made.parts[index], 1
        if not _fits(part, bed):
            done = _smaller(made, index, bed, rules)
            count += len(done.made.parts) - len(made.parts)
            made = done.made
            checks += done.checks
            notes += done.notes
            changed.append(part.name)
            pieces += range(index, index + count)
        index += count
    if not changed:
        return Split(made, ())
    return Split(_inspected(whole, made, changed, pieces, checks, rules), tuple(notes))


@dataclass(frozen=True)
class _Smaller:
    """The parts with one of them so that the bed holds it, what was measured and is told of it."""

    made: PartSet
    checks: tuple[Check, ...]
    notes: tuple[str, ...]


def _smaller(made: PartSet, index: int, bed: tuple[float, float, float], rules: PartRules) -> _Smaller:
    """In pieces, or whole on another side. Raises FabricationError."""
    try:
        return _in_pieces(made, index, bed, rules)
    except FabricationError:
        part = made.parts[index]
        down = other_side(part.surface, bed)
        if down is None:
            raise
    turned = (*made.parts[:index], replace(part, down=down), *made.parts[index + 1 :])
    note = (
        f"{part.name} is too large for the bed on its cut face and lies on another side: see that"
        " supports leave its grooves free"
    )
    return _Smaller(replace(made, parts=turned), (), (note,))


def _in_pieces(made: PartSet, index: int, bed: tuple[float, float, float], rules: PartRules) -> _Smaller:
    whole, count = made.parts[index], 1
    checks: list[Check] = []
    notes: list[str] = []
    while not _fits(made.parts[index + count - 1], bed):
        if count == MOST:
            raise _too_large(
                made.parts[index], bed, "it would take more than six pieces", "too-many-pieces"
            )
        done = _cut(made, index + count - 1, bed, rules)
        made = done.made
        checks += done.checks
        notes.append(done.note)
        count += 1
        # The piece that is cut off fits; the rest comes behind it.
    notes = [n.replace("{pieces}", _letters(whole.name, count)) for n in notes]
    return _Smaller(lettered(made, index, count, whole.name), tuple(checks), tuple(notes))


def _inspected(
    whole: PartSet,
    made: PartSet,
    changed: Sequence[str],
    pieces: Sequence[int],
    checks: Sequence[Check],
    rules: PartRules,
) -> PartSet:
    """With what is measured and told of all parts now in place of what it was of the `whole` ones,
    and of the `pieces` (indices) in place of the `changed` parts (names)."""
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
        if c.name in again or c.name.startswith(tuple(f"{n}: " for n in changed))
    ]
    before = [i for i, p in enumerate(whole.parts) if p.name in changed]
    old = {*(c.note for c in gone), *_told(whole, before, changed)}
    notes = [c.note for c in found if c.note]
    return replace(
        made,
        checks=(*(c for c in made.checks if c not in gone), *found),
        warnings=(
            *(w for w in made.warnings if w not in old),
            *notes,
            *_told(made, pieces, changed),
        ),
    )


def _told(made: PartSet, which: Sequence[int], whole: Sequence[str]) -> list[str]:
    """Of these parts (indices), which are pieces where they are not called as `whole` ones, and of
    all joints."""
    parts = [part_checks.of_part(made, i, made.parts[i].name not in whole) for i in which]
    return [*(w for part in parts for w in part), *part_checks.of_joints(made)]


def _letters(name: str, count: int) -> str:
    return " and ".join(f"{name}-{chr(97 + k)}" for k in range(count))


def _fits(part: Part, bed: tuple[float, float, float]) -> bool:
    return fits(laid(part.surface, part.down), bed)


def _too_large(
    part: Part, bed: tuple[float, float, float], why: str, reason: str
) -> FabricationError:
    x, y, z = np.ptp(laid(part.surface, part.down).bounds, axis=0)
    return FabricationError(
        f"{part.name} measures {x:.0f} x {y:.0f} x {z:.0f} mm as it is printed, which the bed"
        f" ({bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm) does not hold, and neither cutting it across"
        f" nor another side of it helps: {why}; divide it by one more cord plane, make the body"
        " smaller, or state another [fabrication] bed",
        code="part-too-large",
        part=part.name,
        size=(float(x), float(y), float(z)),
        reason=reason,
    )


def _cut(made: PartSet, index: int, bed: tuple[float, float, float], rules: PartRules) -> DowelledCut:
    """Cut a piece off a part that the bed holds: the longest that leaves about equal ones."""
    part = made.parts[index]
    normal = long_way(part)
    longest = reach(part, normal, bed)
    if longest < 2 * SHORTEST:
        size = np.ptp(laid(part.surface, part.down).bounds, axis=0)
        a, b = np.delete(size, size.argmax())
        what = "deep" if size.argmax() == 2 else "high"
        raise _too_large(
            part, bed, f"it is {a:.0f} mm wide and {b:.0f} mm {what}", "cross-section-too-large"
        )
    for height in cut_heights(made, index, normal, longest):
        done = cut_across(made, index, normal, float(height), rules)
        if done is not None:
            return done
    raise _too_large(
        part, bed, "there is no room for two dowels in any of its sections", "no-dowel-room"
    )
