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
    whole_name,
)

FAR_MM = 1e4  # beyond any body


def renumber_parts(
    made: PartSet,
    index: int,
    normal: Float,
    height: float,
    contact: Contact,
    dowels: Sequence[Pin],
    parts: Sequence[Part],
    bares: Sequence[Any],
    removed: float,
) -> PartSet:
    """Return the records of parts where one of them has become two.

    Args:
        made: The parts before.
        index: Index of the part that was cut.
        normal: Unit normal (3,) of the cut.
        height: Height of the cut along it, mm.
        contact: Contact of the two pieces.
        dowels: Dowels in it.
        parts: The pieces below and above.
        bares: The same without channels and sockets.
        removed: Volume that was cut out of them, mm^3.
    """

    def new_index(i: int) -> int:
        return i + 1 if i > index else i

    def new_side(group: tuple[int, ...]) -> tuple[int, ...]:
        out = [new_index(i) for i in group]
        return tuple(sorted([*out, index + 1] if index in group else out))

    contacts: list[Contact] = []
    new_contact: dict[tuple[int, bool], int] = {}
    for k, c in enumerate(made.contacts):
        if index not in (c.lower, c.upper):
            new_contact[k, False] = new_contact[k, True] = len(contacts)
            contacts.append(replace(c, lower=new_index(c.lower), upper=new_index(c.upper)))
            continue
        for above in (False, True):
            own = index + int(above)
            new_contact[k, above] = len(contacts)
            contacts.append(
                replace(
                    c,
                    lower=own if c.lower == index else new_index(c.lower),
                    upper=own if c.upper == index else new_index(c.upper),
                    section=_clip_section(
                        c, normal if above else -normal, height if above else -height
                    ),
                )
            )

    def contact_at(k: int, at: Float) -> int:
        return new_contact[k, bool(at @ normal > height)]

    pins = [replace(p, contact=contact_at(p.contact, p.center)) for p in made.pins]
    labels = [
        replace(
            label,
            part=index + int(bool(label.center @ normal > height))
            if label.part == index
            else new_index(label.part),
            contact=contact_at(label.contact, label.center),
        )
        for label in made.labels
    ]
    cuts = [replace(c, sides=(new_side(c.sides[0]), new_side(c.sides[1]))) for c in made.cuts]
    cuts.append(Cut(contact.plane, contact.plane.origin, (), ((index,), (index + 1,))))
    new = replace(contact, lower=index, upper=index + 1)
    return replace(
        made,
        parts=(*made.parts[:index], *parts, *made.parts[index + 1 :]),
        bare=(*made.bare[:index], *bares, *made.bare[index + 1 :]),
        cuts=tuple(cuts),
        contacts=(*contacts, new),
        pins=(*pins, *(replace(d, contact=len(contacts)) for d in dowels)),
        labels=tuple(labels),
        cut_out=made.cut_out + removed,
    )


def _clip_section(contact: Contact, normal: Float, height: float) -> Any:
    """Return the part of a contact's face that `normal` points to, beyond the height."""
    import manifold3d as m3

    plane = contact.plane
    way = plane.axes[:, :2].T @ normal
    size = float(np.linalg.norm(way))
    if size < 1e-6:
        beyond = float(plane.origin @ normal) >= height
        return contact.section if beyond else m3.CrossSection()
    away = (height - float(plane.origin @ normal)) / size
    x = way / size
    y = np.array([-x[1], x[0]])
    corners = [
        away * x - FAR_MM * y,
        (away + FAR_MM) * x - FAR_MM * y,
    ]
    corners += [
        (away + FAR_MM) * x + FAR_MM * y,
        away * x + FAR_MM * y,
    ]
    return contact.section ^ m3.CrossSection([np.array(corners)])


def letter_pieces(made: PartSet, index: int, count: int, name: str) -> PartSet:
    """Name pieces by letters, in their order."""
    parts = list(made.parts)
    for k in range(count):
        parts[index + k] = replace(parts[index + k], name=f"{name}-{chr(97 + k)}")
    return replace(made, parts=tuple(parts))


SECTION_OFFSET_MM = 0.02  # from the plane, where the faces of both sides are taken
FAR_MM = 1e4  # beyond any body


@dataclass(frozen=True)
class DowelledCut:
    """A cut of one part in two.

    Attributes:
        made: The parts.
        checks: Measurements of the pieces.
        note: What the maker should know, with "{pieces}" in place of their names.
    """

    made: PartSet
    checks: tuple[Check, ...]
    note: str


def cut_across(
    made: PartSet, index: int, normal: Float, height: float, rules: PartRules
) -> DowelledCut | None:
    """Cut a part across.

    Args:
        made: The parts.
        index: Index of the part.
        normal: Unit normal (3,) of the cut.
        height: Height of the cut along it, mm.
        rules: Rules of the parts.

    Returns:
        The cut, or None if two dowels have no room or there would be more than two pieces.

    Raises:
        FabricationError: If the pieces fail a check.
    """
    part, bare = made.parts[index], made.bare[index]
    solid = triangle_kernel.to_manifold(part.surface, part.name)
    halves = solid.split_by_plane((-normal).tolist(), -height)
    bares = bare.split_by_plane((-normal).tolist(), -height)
    if any(len(h.decompose()) != 1 for h in halves):
        return None
    middle = np.asarray(part.center)
    origin = middle + (height - float(middle @ normal)) * normal
    plane = Plane.from_normal(origin, normal, axes_from_normal(normal)[:, 0])
    into = np.column_stack([plane.axes.T, -plane.axes.T @ plane.origin])
    sides = [
        h.transform(into).slice(s)
        for h, s in zip(halves, (-SECTION_OFFSET_MM, SECTION_OFFSET_MM), strict=True)
    ]
    section = (sides[0] ^ sides[1]).simplify(0.01)
    # A dowel must keep away from all facets of the part: skin, joints, grooves, sockets and
    # numbers.
    contact = Contact(len(made.cuts), index, index + 1, plane, section, part.surface, ())
    dowels = place_pins([contact], rules.clearance, rules.inner_wall)
    if len(dowels) < 2:
        return None
    pieces = [
        _make_piece(part, h, dowels, upper, normal, height)
        for h, upper in zip(halves, (False, True), strict=True)
    ]
    note = ""
    if part.solid is not None:
        try:
            pieces = _add_solids(part, pieces, dowels, normal, height)
        except FabricationError as error:  # STL files do not need it
            note = f"; no STEP of them: {error}"
    removed, volume_check = check_piece_volumes(part, pieces, dowels)
    checks = (
        volume_check,
        check_dowel_walls(part, dowels, rules),
        check_dowels_fit(part, pieces, dowels),
        *check_crossings(made, part, pieces, plane, rules),
    )
    crossed_cords = find_crossed_channels(made, part, plane, rules)
    crossing_note = (
        f"; the channels of {', '.join(crossed_cords)} continue across it, so see that no glue"
        f" or edge"
        " stands in them"
        if crossed_cords
        else ""
    )
    spoiled = find_spoiled(made, index, height, normal)
    spoiled_note = (
        f"; no place was free, and the cut passes through or close by {', '.join(spoiled)}: see"
        f" that"
        " these are sound, or use a larger [fabrication] bed"
        if spoiled
        else ""
    )
    return DowelledCut(
        renumber_parts(made, index, normal, height, contact, dowels, pieces, bares, removed),
        checks,
        f"{whole_name(part)} is too long for the bed and is printed in pieces, {{pieces}}, cut"
        f" across near {format_point(origin)}: join them first, with glue"
        f" ({section.area() / 100:.1f} cm2)"
        f" and two dowels of {dowels[0].diameter:g} and {dowels[1].diameter:g} mm"
        f"{crossing_note}{spoiled_note}{note}",
    )


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
    name = f"{whole_name(part)}-rest" if upper else part.name
    center = triangle_kernel.centroid(surface)
    return Part(name, surface, surface.volume, center, part.down)


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
