"""One planar cut across a part, joined by two dowels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.arrays import Float, xyz
from ...core.curve import Plane
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism, frame
from ..parts.alignment_pins import Pin, place_pins
from ..parts.check import Check
from ..parts.part_contacts import Contact
from ..parts.records import Made, Part, Rules
from .cut_places import cut_by
from .inspection import crossed, crossings, dowel_walls, dowels_fit, pieces_add_up, whole_name
from .renumbering import renumbered

_BESIDE = 0.02  # mm, from the plane, where the faces of both sides are taken
_FAR = 1e4  # mm, beyond all of a body


@dataclass(frozen=True)
class DowelledCut:
    """The parts with one of them in two, what was measured of these, and what a maker is told, with
    "{pieces}" in place of their names."""

    made: Made
    checks: tuple[Check, ...]
    note: str


def cut_across(
    made: Made, index: int, normal: Float, height: float, rules: Rules
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
        f" across near {xyz(origin)}: join them first, with glue ({section.area() / 100:.1f} cm2)"
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
