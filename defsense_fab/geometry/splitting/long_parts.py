"""Cut parts that are too long for the bed across, joined by two dowels before all else.

The cut is planar and across the part as it lies on the bed. It keeps away from pins, from the ends
of cords with their pockets, and from numbers; a channel that it crosses continues straight behind
it. If no such cut helps, the part lies on another of its sides, if the bed holds it so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..parts import part_checks
from ..parts.part_checks import check_insertion, check_overlaps, check_thin_places, check_volumes
from ..parts.records import Check, Part, PartRules, PartSet
from ..printing.print_bed import find_other_side, fits_bed, lay_flat
from .cut_places import MIN_PIECE_MM, longest_piece, rank_cut_heights
from .dowelled_cut import Split, cut_across
from .piece_checks import check_one_solid

#: Largest number of pieces of a part.
MAX_PIECES = 6


def split_long_parts(
    part_set: PartSet, bed: tuple[float, float, float], rules: PartRules
) -> PartSet:
    """Cut every part that the bed does not hold across, as often as needed.

    If that does not help, the part is laid on another side.

    Args:
        part_set: The parts.
        bed: Size of the bed, mm.
        rules: Rules of the parts.

    Returns:
        The parts, with checks and warnings for the pieces.

    Raises:
        FabricationError: If neither helps, or pieces fail a check.
    """
    whole, notes = part_set, dict[str, Float]()
    checks: list[Check] = []
    changed: list[str] = []
    pieces: list[int] = []
    index = 0
    while index < len(part_set.parts):
        part, count = _lie_to_fit(part_set, index, bed), 1
        if part is not part_set.parts[index]:
            part_set = _replace_part(part_set, index, part)
        if not _fits(part, bed):
            reduction = _reduce(part_set, index, bed, rules)
            count += len(reduction.part_set.parts) - len(part_set.parts)
            part_set = reduction.part_set
            checks += reduction.checks
            notes |= dict.fromkeys(reduction.notes, part.center)
            changed.append(part.name)
            pieces += range(index, index + count)
        index += count
    if not changed:
        return part_set
    return _update_checks(whole, part_set, changed, pieces, checks, rules).with_warnings(notes)


def _reduce(
    part_set: PartSet, index: int, bed: tuple[float, float, float], rules: PartRules
) -> Split:
    """Cut a part in pieces, or lay it on another side; raise FabricationError if neither helps."""
    try:
        return _cut_in_pieces(part_set, index, bed, rules)
    except FabricationError:
        part = part_set.parts[index]
        down = find_other_side(part.surface, bed)
        if down is None:
            raise
    note = (
        f"{part.name} is too large for the bed on its cut face and lies on another side: see that"
        " supports leave its grooves free"
    )
    return Split(_replace_part(part_set, index, replace(part, down=down)), (), (note,))


def _lie_to_fit(part_set: PartSet, index: int, bed: tuple[float, float, float]) -> Part:
    """Return a part on its first cut face, if the bed holds it there and not as it lies."""
    part, faces = part_set.parts[index], part_set.cut_faces(index)
    if not faces or _fits(part, bed):
        return part
    on_cut_face = replace(part, down=faces[0])
    return on_cut_face if _fits(on_cut_face, bed) else part


def _replace_part(part_set: PartSet, index: int, part: Part) -> PartSet:
    return replace(part_set, parts=(*part_set.parts[:index], part, *part_set.parts[index + 1 :]))


def _cut_in_pieces(
    part_set: PartSet, index: int, bed: tuple[float, float, float], rules: PartRules
) -> Split:
    whole_part, count = part_set.parts[index], 1
    checks: list[Check] = []
    notes: list[str] = []
    while not _fits(part_set.parts[index + count - 1], bed):
        if count == MAX_PIECES:
            raise _too_large(
                part_set.parts[index], bed, "it would take more than six pieces", "too-many-pieces"
            )
        cut = _cut_once(part_set, index + count - 1, bed, rules)
        part_set = cut.part_set
        checks += cut.checks
        notes += cut.notes
        count += 1
        # The piece that is cut off fits; the rest follows it.
    names = [f"{whole_part.name}-{chr(97 + k)}" for k in range(count)]
    parts = list(part_set.parts)
    for k, name in enumerate(names, start=index):
        parts[k] = replace(parts[k], name=name)
    notes = [n.replace("{pieces}", " and ".join(names)) for n in notes]
    return Split(replace(part_set, parts=tuple(parts)), tuple(checks), tuple(notes))


def _update_checks(
    whole: PartSet,
    part_set: PartSet,
    changed: Sequence[str],
    pieces: Sequence[int],
    checks: Sequence[Check],
    rules: PartRules,
) -> PartSet:
    """Return the parts with checks and warnings of the `pieces` (indices) in place of those of the
    `changed` parts (names) of the `whole` set.
    """
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in part_set.parts]
    new_checks = [
        check_volumes(part_set),
        check_overlaps(part_set),
        check_insertion(part_set, solids, rules),
        *check_thin_places(part_set, solids, pieces, rules),
        *(check_one_solid(part_set.parts[k]) for k in pieces),
        *checks,
    ]
    new_names = {c.name for c in new_checks}
    old_checks = [
        c
        for c in part_set.checks
        if c.name in new_names or c.name.startswith(tuple(f"{n}: " for n in changed))
    ]
    before = [i for i, p in enumerate(whole.parts) if p.name in changed]
    old_notes = {*(c.note for c in old_checks), *_notes_on(whole, before, changed)}
    notes = {c.note: c.point for c in new_checks if c.note}
    kept = replace(
        part_set,
        checks=(*(c for c in part_set.checks if c not in old_checks), *new_checks),
        warnings={w: point for w, point in part_set.warnings.items() if w not in old_notes},
    )
    return kept.with_warnings(notes | _notes_on(part_set, pieces, changed))


def _notes_on(part_set: PartSet, which: Sequence[int], whole: Sequence[str]) -> dict[str, Float]:
    """Return notes on parts and on all joints, each with a point (3,) mm.

    Args:
        part_set: All parts.
        which: Indices of the parts.
        whole: Names of the parts that are not pieces.
    """
    notes: dict[str, Float] = {}
    for i in which:
        notes |= part_checks.part_notes(part_set, i, part_set.parts[i].name not in whole)
    return notes | part_checks.joint_notes(part_set)


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
    part_set: PartSet, index: int, bed: tuple[float, float, float], rules: PartRules
) -> Split:
    """Cut the longest piece that leaves about equal ones off a part."""
    part = part_set.parts[index]
    normal, max_length = longest_piece(part, bed)
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
    for height in rank_cut_heights(part_set, index, normal, max_length, rules.kept):
        cut = cut_across(part_set, index, normal, float(height), rules)
        if cut is not None:
            return cut
    raise _too_large(
        part,
        bed,
        "there is no room for two dowels in any of its sections"
        + (" that keep away from [fabrication] keep_whole" if rules.kept else ""),
        "no-dowel-room",
    )
