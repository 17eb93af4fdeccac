"""Cut a part across in one plane and join it by two dowels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism, axes_from_normal
from ..parts.alignment_pins import Pin, place_pins
from ..parts.division import Cut
from ..parts.part_contacts import Contact
from ..parts.records import Check, Part, PartRules, PartSet
from .cut_places import find_spoiled
from .piece_checks import (
    check_crossings,
    check_dowel_walls,
    check_dowels_fit,
    check_piece_volumes,
    find_crossed_channels,
)

SECTION_OFFSET_MM = 0.02  # from the plane, where the faces of both sides are taken
FAR_MM = 1e4  # beyond any body


@dataclass(frozen=True)
class _CutPart:
    """A part that was cut in two.

    Attributes:
        index: Index of the part.
        normal: Unit normal (3,) of the cut.
        height: Height of the cut along it, mm.
        contact: Contact of the two pieces.
        dowels: Dowels in it.
        pieces: The pieces below and above.
        bares: The same without channels and sockets.
        removed: Volume that was cut out of them, mm^3.
    """

    index: int
    normal: Float
    height: float
    contact: Contact
    dowels: Sequence[Pin]
    pieces: Sequence[Part]
    bares: Sequence[Any]
    removed: float

    def is_above(self, point: Float) -> bool:
        """Return whether a point (3,) lies in the upper piece."""
        return bool(point @ self.normal > self.height)

    def new_index(self, i: int, above: bool) -> int:
        """Return the new index of part `i`: of one piece if it is the part that was cut."""
        return i + int(above) if i == self.index else i + int(i > self.index)

    def new_side(self, side: tuple[int, ...]) -> tuple[int, ...]:
        """Return the new indices of the parts on one side of a cut."""
        return tuple(sorted({self.new_index(i, above) for i in side for above in (False, True)}))


def _renumber_parts(part_set: PartSet, cut: _CutPart) -> PartSet:
    """Return the records of parts where one of them has become two."""
    contacts: list[Contact] = []
    new_contact: dict[tuple[int, bool], int] = {}
    for k, c in enumerate(part_set.contacts):
        is_divided = cut.index in (c.lower, c.upper)
        for above in (False, True):
            if above and not is_divided:
                new_contact[k, above] = new_contact[k, False]
                continue
            new_contact[k, above] = len(contacts)
            sign = 1.0 if above else -1.0
            contacts.append(
                replace(
                    c,
                    lower=cut.new_index(c.lower, above),
                    upper=cut.new_index(c.upper, above),
                    section=_clip_section(c, sign * cut.normal, sign * cut.height)
                    if is_divided
                    else c.section,
                )
            )
    pins = [
        replace(p, contact=new_contact[p.contact, cut.is_above(p.center)]) for p in part_set.pins
    ]
    labels = [
        replace(
            label,
            part=cut.new_index(label.part, cut.is_above(label.center)),
            contact=new_contact[label.contact, cut.is_above(label.center)],
        )
        for label in part_set.labels
    ]
    cuts = [
        replace(c, sides=(cut.new_side(c.sides[0]), cut.new_side(c.sides[1])))
        for c in part_set.cuts
    ]
    plane, index = cut.contact.plane, cut.index
    return replace(
        part_set,
        parts=(*part_set.parts[:index], *cut.pieces, *part_set.parts[index + 1 :]),
        bare=(*part_set.bare[:index], *cut.bares, *part_set.bare[index + 1 :]),
        cuts=(*cuts, Cut(plane, plane.origin, (), ((index,), (index + 1,)))),
        contacts=(*contacts, cut.contact),
        pins=(*pins, *(replace(d, contact=len(contacts)) for d in cut.dowels)),
        labels=tuple(labels),
        cut_out=part_set.cut_out + cut.removed,
        carved=(),
    )


def _clip_section(contact: Contact, normal: Float, height: float) -> Any:
    """Return the part of a contact's face that `normal` points to, beyond the height."""
    import manifold3d as m3

    plane = contact.plane
    way = plane.axes[:, :2].T @ normal
    size = float(np.linalg.norm(way))
    rise = height - float(plane.origin @ normal)
    if size < 1e-6:
        return contact.section if rise <= 0 else m3.CrossSection()
    away, x = rise / size, way / size
    y = FAR_MM * np.array([-x[1], x[0]])
    near, far = away * x, (away + FAR_MM) * x
    return contact.section ^ m3.CrossSection([np.array([near - y, far - y, far + y, near + y])])


@dataclass(frozen=True)
class Split:
    """Parts of which one was split.

    Attributes:
        part_set: The parts.
        checks: Measurements of the pieces.
        notes: What the maker should know, with "{pieces}" in place of their names.
    """

    part_set: PartSet
    checks: tuple[Check, ...]
    notes: tuple[str, ...]


def cut_across(
    part_set: PartSet, index: int, normal: Float, height: float, rules: PartRules
) -> Split | None:
    """Cut a part across.

    Args:
        part_set: The parts.
        index: Index of the part.
        normal: Unit normal (3,) of the cut.
        height: Height of the cut along it, mm.
        rules: Rules of the parts.

    Returns:
        The cut, or None if two dowels have no room or there would be more than two pieces.

    Raises:
        FabricationError: If the pieces fail a check.
    """
    part, bare = part_set.parts[index], part_set.bare[index]
    solid = triangle_kernel.to_manifold(part.surface, part.name)
    halves, bares = (s.split_by_plane((-normal).tolist(), -height) for s in (solid, bare))
    if any(len(h.decompose()) != 1 for h in halves):
        return None
    middle = np.asarray(part.center)
    origin = middle + (height - float(middle @ normal)) * normal
    plane = Plane.from_normal(origin, normal, axes_from_normal(normal)[:, 0])
    sides = [
        triangle_kernel.to_plane_frame(h, plane.axes, origin).slice(s)
        for h, s in zip(halves, (-SECTION_OFFSET_MM, SECTION_OFFSET_MM), strict=True)
    ]
    section = (sides[0] ^ sides[1]).simplify(0.01)
    # A dowel must keep away from all facets of the part: skin, joints, grooves, sockets and
    # numbers.
    contact = Contact(len(part_set.cuts), index, index + 1, plane, section, part.surface, ())
    dowels = place_pins([contact], rules.clearance, rules.inner_wall)
    if len(dowels) < 2:
        return None
    pieces = [
        _make_piece(part, h, dowels, upper, normal, height)
        for h, upper in zip(halves, (False, True), strict=True)
    ]
    failure = ""
    if part.solid is not None:
        try:
            pieces = _add_solids(part, pieces, dowels, normal, height)
        except FabricationError as error:  # STL files do not need it
            failure = f"; no STEP of them: {error}"
    removed, volume_check = check_piece_volumes(part, pieces, dowels)
    checks = (
        volume_check,
        check_dowel_walls(part, dowels, rules),
        check_dowels_fit(part, pieces, dowels),
        *check_crossings(part_set, part, pieces, plane, rules),
    )
    warning = _crossing_warning(part_set, index, plane, height, rules)
    cut = _CutPart(index, normal, height, contact, dowels, pieces, bares, removed)
    note = (
        f"{part.name} is too long for the bed and is printed in pieces, {{pieces}}, cut"
        f" across near {format_point(origin)}: join them first, with glue"
        f" ({section.area() / 100:.1f} cm2)"
        f" and two dowels of {dowels[0].diameter:g} and {dowels[1].diameter:g} mm"
        f"{warning}{failure}"
    )
    return Split(_renumber_parts(part_set, cut), checks, (note,))


def _crossing_warning(
    part_set: PartSet, index: int, plane: Plane, height: float, rules: PartRules
) -> str:
    """Return a warning of the channels and details that a cut passes through; empty without any."""
    warning = ""
    cords = find_crossed_channels(part_set, part_set.parts[index], plane, rules)
    if cords:
        warning += (
            f"; the channels of {', '.join(cords)} continue across it, so see that no glue or edge"
            " stands in them"
        )
    spoiled = find_spoiled(part_set, index, height, plane.normal)
    if spoiled:
        warning += (
            f"; no place was free, and the cut passes through or close by {', '.join(spoiled)}: see"
            " that these are sound, or use a larger [fabrication] bed"
        )
    return warning


def _make_piece(
    part: Part, half: Any, dowels: Sequence[Pin], upper: bool, normal: Float, height: float
) -> Part:
    """Return a piece with its sockets, without a solid of OpenCascade."""
    out = -normal if upper else normal
    surface = triangle_kernel.to_printable_surface(
        triangle_kernel.cut_out(half, [d.socket_in(upper=upper) for d in dowels]),
        part.name,
        [(out, -height if upper else height)],
    )
    center = surface.centroid
    return Part(part.name, surface, surface.volume, center, part.down)


def _add_solids(
    part: Part, halves: Sequence[Part], dowels: Sequence[Pin], normal: Float, height: float
) -> list[Part]:
    """Return the pieces with their solids of OpenCascade, cut from the part's.

    Raises FabricationError if that fails, or the solids differ from the facets.
    """
    from ..parts.exact_solids import carve_solid, check_volumes_agree

    square = FAR_MM * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    out = []
    for half, upper in zip(halves, (False, True), strict=True):
        direction = -normal if upper else normal
        away = Prism(height * normal, axes_from_normal(direction), square, FAR_MM)
        solid = carve_solid(part.solid, [away, *(d.socket_in(upper=upper) for d in dowels)])
        check_volumes_agree(half.name, solid, half.volume, part.volume)
        out.append(replace(half, solid=solid))
    return out
