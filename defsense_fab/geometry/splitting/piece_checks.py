"""What the pieces of a part that was cut across are measured for, by their own facets.

Walls are measured in the part as it was before the cut: all of its facets, grooves, sockets and
numbers among them, are what a dowel must keep away from. Every check raises FabricationError, with
the part and the place (mm), where it fails.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import igl
import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import frame
from ..parts.alignment_pins import Pin, gap
from ..parts.part_checks import CONSERVATION, TOUCH, touch
from ..parts.records import Check, PartSet, Part, PartRules
from ..parts.wall_checks import TOLERANCE, shell

_NEAR = 2.0  # mm, along a channel, on both sides of a cut across it
_FACETS = 0.02  # mm, by which a channel's facets may be nearer than its radius
_HELP = "divide the body by one more cord plane, or state another [fabrication] bed"


def whole_name(part: Part) -> str:
    """Of the part that a piece belongs to, while it is being cut."""
    return part.name.removesuffix("-rest")


def one_solid(part: Part) -> Check:
    """A piece's facets are closed, and bound one solid."""
    count = len(triangle_kernel.to_manifold(part.surface, part.name).decompose())
    if count != 1:
        raise FabricationError(
            f"{part.name} is in {count} pieces that do not hang together; {_HELP}",
            code="not-one-piece",
            part=part.name,
            count=count,
        )
    return Check(f"solids of {part.name}", float(count), 1.0, "", "")


def pieces_add_up(part: Part, pieces: Sequence[Part], dowels: Sequence[Pin]) -> tuple[float, Check]:
    """The volume of the part in the dowels' sockets, mm^3, and whether it and the pieces are the
    part."""
    solid = triangle_kernel.to_manifold(part.surface, part.name)
    sockets = [
        triangle_kernel.solid_of(d.socket_in(upper)) for d in dowels for upper in (False, True)
    ]
    removed = float((solid ^ triangle_kernel.union(sockets)).volume())
    error = abs((sum(p.volume for p in pieces) + removed) / part.volume - 1)
    name = f"volume lost or gained by cutting {whole_name(part)} across, of it"
    if not error <= CONSERVATION:
        raise FabricationError(
            f"{name}: {error:.2%}; the cut failed: {_HELP}",
            code="volume-not-conserved",
            part=whole_name(part),
        )
    return removed, Check(name, error, CONSERVATION, "", "")


def dowel_walls(part: Part, dowels: Sequence[Pin], rules: PartRules) -> Check:
    """The least wall around the dowels' sockets: to all that bounds the part, and to each other."""
    least, at = np.inf, ""
    for k, dowel in enumerate(dowels):
        hull = shell(dowel)
        away = np.minimum(_depth(hull, part.surface), gap(hull, dowels[:k]))
        if away.min() < least:
            least, at = float(away.min()), format_point(hull[int(away.argmin())])
    name = f"wall around the dowels of {whole_name(part)}"
    check = Check(name, least, rules.inner_wall - TOLERANCE, "mm", at, at_least=True)
    if not check.holds:
        raise FabricationError(
            f"{name}: {least:.2f} mm near {at}; {rules.inner_wall:.2f} mm is needed: {_HELP}",
            code="wall-too-thin",
            part=whole_name(part),
            wall=least,
        )
    return check


def dowels_fit(part: Part, pieces: Sequence[Part], dowels: Sequence[Pin]) -> Check:
    """The dowels themselves, in the middle of their sockets, touch neither piece."""
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in pieces]
    worst = 0.0
    for dowel in dowels:
        start = dowel.center - dowel.length / 2 * dowel.axis
        rod = triangle_kernel.union([triangle_kernel.solid_of(t) for t in dowel.shape])
        rod = rod.transform(np.column_stack([frame(dowel.axis), start]))
        what = f"the dowel of {dowel.diameter:g} mm between the pieces of {whole_name(part)}"
        worst = max(worst, *(touch(rod, s, what, _HELP) for s in solids))
    return Check(f"dowels in the solid of {whole_name(part)}", worst, TOUCH, "mm3", "")


def crossed(made: PartSet, part: Part, plane: Plane, rules: PartRules) -> dict[str, tuple[Float, float]]:
    """The cords and wires whose channels a plane cuts in a part, by what a maker calls them: their
    centre lines (n, 3) mm near it, and their radii, mm."""
    out = {}
    for what, line, radius, hollow in _lines(made, rules):
        height = (line - plane.origin) @ plane.normal
        at = np.flatnonzero((height[1:] > 0) != (height[:-1] > 0))
        # A channel of this part has its walls, or one half of them, in the part's facets.
        own = (
            at[_distance(line[at], part.surface) < hollow + rules.inner_wall / 2] if len(at) else at
        )
        if len(own):
            away = np.linalg.norm(line[:, None] - line[own], axis=2).min(axis=1)
            out[what] = (line[away < _NEAR], radius)
    return out


def crossings(
    made: PartSet, part: Part, pieces: Sequence[Part], plane: Plane, rules: PartRules
) -> list[Check]:
    """Every channel that the cut crosses goes on behind it: as much room around the cord, or wire,
    in both pieces as it is thick."""
    out = []
    for what, (line, radius) in crossed(made, part, plane, rules).items():
        room = np.min([-_depth(line, p.surface) for p in pieces], axis=0)
        k = int(room.argmin())
        name = f"room around {what} where {whole_name(part)} is cut across"
        check = Check(name, float(room[k]), radius - _FACETS, "mm", format_point(line[k]), at_least=True)
        if not check.holds:
            raise FabricationError(
                f"{name}: {room[k]:.2f} mm near {check.at}, {radius:.2f} mm is needed: {_HELP}",
                code="channel-blocked",
                what=what,
                room=float(room[k]),
            )
        out.append(check)
    return out


def _lines(made: PartSet, rules: PartRules) -> Iterator[tuple[str, Float, float, float]]:
    """What runs in a channel, the channel's centre line (n, 3) mm, and the radii of both, mm."""
    wires = rules.pockets.wires if rules.pockets else None
    for channel in made.channels:
        yield f"cord {channel.name}", channel.inside, rules.cord / 2, rules.channel / 2
        for end, which in zip(channel.ends, ("start", "end"), strict=True):
            if end.lead and wires:
                what = f"the wire at the {which} of cord {channel.name}"
                yield what, end.lead.inside, wires.wire / 2, wires.diameter / 2


def _depth(points: Float, surface: Surface) -> Float:
    """How deep (n,) mm points lie in a solid; below zero outside."""
    inside = np.asarray(igl.fast_winding_number(surface.vertices, surface.faces, points)) > 0.5
    return np.where(inside, 1.0, -1.0) * _distance(points, surface)


def _distance(points: Float, surface: Surface) -> Float:
    square = igl.point_mesh_squared_distance(points, surface.vertices, surface.faces)[0]
    return np.asarray(np.sqrt(np.atleast_1d(square)))
