"""Cut parts that are too long for the bed across, joined by two dowels before all else.

The cut is planar and across the part as it lies on the bed. It keeps away from pins, from the ends
of cords with their pockets, and from numbers; a channel that it crosses continues straight behind
it. If no such cut helps, the part lies on another of its sides, if the bed holds it so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..parts import part_checks
from ..parts.part_checks import check_insertion, check_overlaps, check_thin_places, check_volumes
from ..parts.records import Check, Part, PartRules, PartSet
from ..printing.print_bed import find_other_side, fits_bed, lay_flat
from .cut_places import MIN_PIECE_MM, longest_direction, longest_piece, rank_cut_heights
from .dowelled_cut import DowelledCut, cut_across, letter_pieces
from .piece_checks import check_one_solid

#: Largest number of pieces of a part.
MAX_PIECES = 6


@dataclass(frozen=True)
class SplitParts:
    """Parts that fit the bed.

    Attributes:
        made: The parts, with checks and warnings for the pieces.
        notes: What the maker should know of the pieces.
    """

    made: PartSet
    notes: tuple[str, ...]


def split_long_parts(
    made: PartSet, bed: tuple[float, float, float], rules: PartRules
) -> SplitParts:
    """Cut every part that the bed does not hold across, as often as needed.

    If that does not help, the part is laid on another side.

    Args:
        made: The parts.
        bed: Size of the bed, mm.
        rules: Rules of the parts.

    Raises:
        FabricationError: If neither helps, or pieces fail a check.
    """
    whole, notes = made, list[str]()
    checks: list[Check] = []
    changed: list[str] = []
    pieces: list[int] = []
    index = 0
    while index < len(made.parts):
        part, count = made.parts[index], 1
        if not _fits(part, bed):
            reduction = _reduce(made, index, bed, rules)
            count += len(reduction.made.parts) - len(made.parts)
            made = reduction.made
            checks += reduction.checks
            notes += reduction.notes
            changed.append(part.name)
            pieces += range(index, index + count)
        index += count
    if not changed:
        return SplitParts(made, ())
    return SplitParts(_update_checks(whole, made, changed, pieces, checks, rules), tuple(notes))


@dataclass(frozen=True)
class _Reduction:
    """The parts with one of them reduced to fit the bed, with checks and notes."""

    made: PartSet
    checks: tuple[Check, ...]
    notes: tuple[str, ...]


def _reduce(
    made: PartSet, index: int, bed: tuple[float, float, float], rules: PartRules
) -> _Reduction:
    """Cut a part in pieces, or lay it on another side; raise FabricationError if neither helps."""
    try:
        return _cut_in_pieces(made, index, bed, rules)
    except FabricationError:
        part = made.parts[index]
        down = find_other_side(part.surface, bed)
        if down is None:
            raise
    parts = (*made.parts[:index], replace(part, down=down), *made.parts[index + 1 :])
    note = (
        f"{part.name} is too large for the bed on its cut face and lies on another side: see that"
        " supports leave its grooves free"
    )
    return _Reduction(replace(made, parts=parts), (), (note,))


def _cut_in_pieces(
    made: PartSet, index: int, bed: tuple[float, float, float], rules: PartRules
) -> _Reduction:
    whole_part, count = made.parts[index], 1
    checks: list[Check] = []
    notes: list[str] = []
    while not _fits(made.parts[index + count - 1], bed):
        if count == MAX_PIECES:
            raise _too_large(
                made.parts[index], bed, "it would take more than six pieces", "too-many-pieces"
            )
        cut = _cut_once(made, index + count - 1, bed, rules)
        made = cut.made
        checks += cut.checks
        notes.append(cut.note)
        count += 1
        # The piece that is cut off fits; the rest follows it.
    notes = [n.replace("{pieces}", _list_pieces(whole_part.name, count)) for n in notes]
    return _Reduction(
        letter_pieces(made, index, count, whole_part.name), tuple(checks), tuple(notes)
    )


def _update_checks(
    whole: PartSet,
    made: PartSet,
    changed: Sequence[str],
    pieces: Sequence[int],
    checks: Sequence[Check],
    rules: PartRules,
) -> PartSet:
    """Return the parts with checks and warnings of the `pieces` (indices) in place of those of the
    `changed` parts (names) of the `whole` set.
    """
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in made.parts]
    new_checks = [
        check_volumes(made),
        check_overlaps(made),
        check_insertion(made, solids, rules),
        *check_thin_places(made, solids, pieces, rules),
        *(check_one_solid(made.parts[k]) for k in pieces),
        *checks,
    ]
    new_names = {c.name for c in new_checks}
    old_checks = [
        c
        for c in made.checks
        if c.name in new_names or c.name.startswith(tuple(f"{n}: " for n in changed))
    ]
    before = [i for i, p in enumerate(whole.parts) if p.name in changed]
    old_notes = {*(c.note for c in old_checks), *_notes_on(whole, before, changed)}
    notes = [c.note for c in new_checks if c.note]
    return replace(
        made,
        checks=(*(c for c in made.checks if c not in old_checks), *new_checks),
        warnings=(
            *(w for w in made.warnings if w not in old_notes),
            *notes,
            *_notes_on(made, pieces, changed),
        ),
    )


def _notes_on(made: PartSet, which: Sequence[int], whole: Sequence[str]) -> list[str]:
    """Return notes on these parts (indices), which are pieces unless they are named as `whole`
    ones, and on all joints.
    """
    parts = [part_checks.part_notes(made, i, made.parts[i].name not in whole) for i in which]
    return [*(w for part in parts for w in part), *part_checks.joint_notes(made)]


def _list_pieces(name: str, count: int) -> str:
    return " and ".join(f"{name}-{chr(97 + k)}" for k in range(count))


def _fits(part: Part, bed: tuple[float, float, float]) -> bool:
    return fits_bed(lay_flat(part.surface, part.down), bed)


def _too_large(
    part: Part, bed: tuple[float, float, float], explanation: str, reason: str
) -> FabricationError:
    x, y, z = np.ptp(lay_flat(part.surface, part.down).bounds, axis=0)
    return FabricationError(
        f"measures {x:.0f} x {y:.0f} x {z:.0f} mm as it is printed, which the bed ({bed[0]:g} x"
        f" {bed[1]:g} x {bed[2]:g} mm) does not hold, and neither cutting it across nor another"
        f" side helps: {explanation}",
        code="part-too-large",
        where=part.name,
        action="Divide it by one more cord plane, make the body smaller, or state another"
        " [fabrication] bed",
        part=part.name,
        size=(float(x), float(y), float(z)),
        reason=reason,
    )


def _cut_once(
    made: PartSet, index: int, bed: tuple[float, float, float], rules: PartRules
) -> DowelledCut:
    """Cut the longest piece that leaves about equal ones off a part."""
    part = made.parts[index]
    normal = longest_direction(part)
    max_length = longest_piece(part, normal, bed)
    if max_length < 2 * MIN_PIECE_MM:
        size = np.ptp(lay_flat(part.surface, part.down).bounds, axis=0)
        a, b = np.delete(size, size.argmax())
        dimension = "deep" if size.argmax() == 2 else "high"
        raise _too_large(
            part,
            bed,
            f"it is {a:.0f} mm wide and {b:.0f} mm {dimension}",
            "cross-section-too-large",
        )
    for height in rank_cut_heights(made, index, normal, max_length):
        cut = cut_across(made, index, normal, float(height), rules)
        if cut is not None:
            return cut
    raise _too_large(
        part, bed, "there is no room for two dowels in any of its sections", "no-dowel-room"
    )
