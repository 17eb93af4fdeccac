"""One planar cut across a part, joined by two dowels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism, frame
from ..parts.alignment_pins import Pin, place_pins
from ..parts.division import Cut
from ..parts.part_contacts import Contact
from ..parts.records import Check, PartSet, Part, PartRules
from .cut_places import cut_by
from .piece_checks import crossed, crossings, dowel_walls, dowels_fit, pieces_add_up, whole_name

# The records of parts where one of them has become two.

_FAR_RENUMBERING = 1e4  # mm, beyond all of a body


def renumbered(
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
    """All that names parts by their index, with the part at `index` in two: `parts` and, without
    channels and sockets, `bares` below and above the plane at `height` mm along `normal`; they
    meet in `contact`, with `dowels`, and `removed` mm^3 were cut out of them."""

    def moved(i: int) -> int:
        return i + 1 if i > index else i

    def side(group: tuple[int, ...]) -> tuple[int, ...]:
        out = [moved(i) for i in group]
        return tuple(sorted([*out, index + 1] if index in group else out))

    old: list[Contact] = []
    where: dict[tuple[int, bool], int] = {}
    for k, c in enumerate(made.contacts):
        if index not in (c.lower, c.upper):
            where[k, False] = where[k, True] = len(old)
            old.append(replace(c, lower=moved(c.lower), upper=moved(c.upper)))
            continue
        for above in (False, True):
            own = index + int(above)
            where[k, above] = len(old)
            old.append(
                replace(
                    c,
                    lower=own if c.lower == index else moved(c.lower),
                    upper=own if c.upper == index else moved(c.upper),
                    section=_clipped(c, normal if above else -normal, height if above else -height),
                )
            )

    def owner(k: int, at: Float) -> int:
        return where[k, bool(at @ normal > height)]

    pins = [replace(p, contact=owner(p.contact, p.center)) for p in made.pins]
    labels = [
        replace(
            label,
            part=index + int(bool(label.center @ normal > height))
            if label.part == index
            else moved(label.part),
            contact=owner(label.contact, label.center),
        )
        for label in made.labels
    ]
    cuts = [replace(c, sides=(side(c.sides[0]), side(c.sides[1]))) for c in made.cuts]
    cuts.append(Cut(contact.plane, contact.plane.origin, (), ((index,), (index + 1,))))
    new = replace(contact, lower=index, upper=index + 1)
    return replace(
        made,
        parts=(*made.parts[:index], *parts, *made.parts[index + 1 :]),
        bare=(*made.bare[:index], *bares, *made.bare[index + 1 :]),
        cuts=tuple(cuts),
        contacts=(*old, new),
        pins=(*pins, *(replace(d, contact=len(old)) for d in dowels)),
        labels=tuple(labels),
        cut_out=made.cut_out + removed,
    )


def _clipped(contact: Contact, normal: Float, height: float) -> Any:
    """What of a contact's face lies where `normal` looks, beyond the height."""
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
        away * x - _FAR_RENUMBERING * y,
        (away + _FAR_RENUMBERING) * x - _FAR_RENUMBERING * y,
    ]
    corners += [
        (away + _FAR_RENUMBERING) * x + _FAR_RENUMBERING * y,
        away * x + _FAR_RENUMBERING * y,
    ]
    return contact.section ^ m3.CrossSection([np.array(corners)])


def lettered(made: PartSet, index: int, count: int, name: str) -> PartSet:
    """Pieces by letters, in the order in which they follow one another."""
    parts = list(made.parts)
    for k in range(count):
        parts[index + k] = replace(parts[index + k], name=f"{name}-{chr(97 + k)}")
    return replace(made, parts=tuple(parts))


_BESIDE = 0.02  # mm, from the plane, where the faces of both sides are taken
_FAR = 1e4  # mm, beyond all of a body


@dataclass(frozen=True)
class DowelledCut:
    """The parts with one of them in two, what was measured of these, and what a maker is told, with
    "{pieces}" in place of their names."""

    made: PartSet
    checks: tuple[Check, ...]
    note: str


def cut_across(
    made: PartSet, index: int, normal: Float, height: float, rules: PartRules
) -> DowelledCut | None:
    """The part at `index` cut in the plane at `height` mm along the unit `normal` (3,), or None
    where two dowels have no room or more than two pieces would come of it. Raises FabricationError
    where the pieces fail a check."""
    part, bare = made.parts[index], made.bare[index]
    solid = triangle_kernel.to_manifold(part.surface, part.name)
    halves = solid.split_by_plane((-normal).tolist(), -height)
    bares = bare.split_by_plane((-normal).tolist(), -height)
    if any(len(h.decompose()) != 1 for h in halves):
        return None
    middle = np.asarray(part.center)
    origin = middle + (height - float(middle @ normal)) * normal
    plane = Plane.from_normal(origin, normal, frame(normal)[:, 0])
    into = np.column_stack([plane.axes.T, -plane.axes.T @ plane.origin])
    sides = [h.transform(into).slice(s) for h, s in zip(halves, (-_BESIDE, _BESIDE), strict=True)]
    section = (sides[0] ^ sides[1]).simplify(0.01)
    # The part's own facets are all that a dowel must keep away from: skin, joints, grooves,
    # sockets and numbers.
    contact = Contact(len(made.cuts), index, index + 1, plane, section, part.surface, ())
    dowels = place_pins([contact], rules.clearance, rules.inner_wall)
    if len(dowels) < 2:
        return None
    parts = [
        _half(part, h, dowels, upper, normal, height)
        for h, upper in zip(halves, (False, True), strict=True)
    ]
    note = ""
    if part.solid is not None:
        try:
            parts = _with_solids(part, parts, dowels, normal, height)
        except FabricationError as error:  # the STL do not need it
            note = f"; no STEP of them: {error}"
    removed, added_up = pieces_add_up(part, parts, dowels)
    checks = (
        added_up,
        dowel_walls(part, dowels, rules),
        dowels_fit(part, parts, dowels),
        *crossings(made, part, parts, plane, rules),
    )
    through = crossed(made, part, plane, rules)
    across = (
        f"; the channels of {', '.join(through)} go on across it, so see that no glue or edge"
        " stands in them"
        if through
        else ""
    )
    spoilt = cut_by(made, index, height, normal)
    near = (
        f"; no place was free, and the cut passes through or close by {', '.join(spoilt)}: see that"
        " these are sound, or use a larger [fabrication] bed"
        if spoilt
        else ""
    )
    return DowelledCut(
        renumbered(made, index, normal, height, contact, dowels, parts, bares, removed),
        checks,
        f"{whole_name(part)} is too long for the bed and is printed in pieces, {{pieces}}, cut"
        f" across near {format_point(origin)}: join them first, with glue ({section.area() / 100:.1f} cm2)"
        f" and two dowels of {dowels[0].diameter:g} and {dowels[1].diameter:g} mm"
        f"{across}{near}{note}",
    )


def _half(
    part: Part, half: Any, dowels: Sequence[Pin], upper: bool, normal: Float, height: float
) -> Part:
    """A piece with its sockets; no solid of OpenCascade yet."""
    out = -normal if upper else normal
    surface = triangle_kernel.printable(
        triangle_kernel.without(half, [d.socket_in(upper=upper) for d in dowels]),
        part.name,
        [(out, -height if upper else height)],
    )
    name = f"{whole_name(part)}-rest" if upper else part.name
    center = triangle_kernel.centroid(surface)
    return Part(name, surface, surface.volume, center, part.down)


def _with_solids(
    part: Part, halves: Sequence[Part], dowels: Sequence[Pin], normal: Float, height: float
) -> list[Part]:
    """The pieces with their solids of OpenCascade, which are cut from the part's. Raises
    FabricationError where that fails, or the solids are not those of the facets."""
    from ..parts.exact_solids import agree, carved

    square = _FAR * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    out = []
    for half, upper in zip(halves, (False, True), strict=True):
        way = -normal if upper else normal
        away = Prism(height * normal, frame(way), square, _FAR)
        solid = carved(part.solid, [away, *(d.socket_in(upper=upper) for d in dowels)])
        agree(half.name, solid, half.volume, part.volume)
        out.append(replace(half, solid=solid))
    return out
