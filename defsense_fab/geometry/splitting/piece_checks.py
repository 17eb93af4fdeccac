"""Check the pieces of a part that was cut across, by their own facets.

Walls are measured in the part as it was before the cut: a dowel must keep away from all of its
facets, including grooves, sockets and numbers. Every check raises FabricationError, with the part
and the place (mm), if it fails.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import axes_from_normal
from ..kernels.surface_queries import signed_distance_of
from ..parts.alignment_pins import Pin, distance_to_sockets
from ..parts.part_checks import MAX_OVERLAP_MM3, VOLUME_TOLERANCE, check_overlap
from ..parts.records import Check, Part, PartRules, PartSet
from ..parts.wall_checks import SOCKET_TOLERANCE_MM, socket_points

CROSSING_LENGTH_MM = 2.0  # along a channel, on both sides of a cut across it
FACET_TOLERANCE_MM = 0.02  # by which a channel's facets may be nearer than its radius
REMEDY = "Divide the body by one more cord plane, or state another [fabrication] bed"


def check_one_solid(part: Part) -> Check:
    """Check that a piece's facets are closed and bound one solid."""
    count = len(triangle_kernel.to_manifold(part.surface, part.name).decompose())
    if count != 1:
        raise FabricationError(
            f"is in {count} separate pieces",
            code="not-one-piece",
            where=part.name,
            action=REMEDY,
            part=part.name,
            count=count,
        )
    return Check(f"solids of {part.name}", float(count), 1.0, "", "")


def check_piece_volumes(
    part: Part, pieces: Sequence[Part], dowels: Sequence[Pin]
) -> tuple[float, Check]:
    """Return the volume of the part in the dowels' sockets, mm^3, and check that it and the pieces
    are the part.
    """
    solid = triangle_kernel.to_manifold(part.surface, part.name)
    sockets = [
        triangle_kernel.solid_of(d.socket_in(upper)) for d in dowels for upper in (False, True)
    ]
    removed = float((solid ^ triangle_kernel.union(sockets)).volume())
    error = abs((sum(p.volume for p in pieces) + removed) / part.volume - 1)
    name = f"volume lost or gained by cutting {part.name} across, of it"
    if not error <= VOLUME_TOLERANCE:
        raise FabricationError(
            f"{error:.2%}: the cut failed",
            code="volume-not-conserved",
            where=name,
            action=REMEDY,
            part=part.name,
        )
    return removed, Check(name, error, VOLUME_TOLERANCE, "", "")


def check_dowel_walls(part: Part, dowels: Sequence[Pin], rules: PartRules) -> Check:
    """Check the least wall around the dowels' sockets: to all that bounds the part, and to each
    other.
    """
    wall, at = np.inf, ""
    for k, dowel in enumerate(dowels):
        surface_points = socket_points(dowel)
        distance = np.minimum(
            signed_distance_of(part.surface)(surface_points),
            distance_to_sockets(surface_points, dowels[:k]),
        )
        if distance.min() < wall:
            wall, at = float(distance.min()), format_point(surface_points[int(distance.argmin())])
    name = f"wall around the dowels of {part.name}"
    check = Check(name, wall, rules.inner_wall - SOCKET_TOLERANCE_MM, "mm", at, at_least=True)
    return check.require(rules.inner_wall, "wall-too-thin", REMEDY, part=part.name, wall=wall)


def check_dowels_fit(part: Part, pieces: Sequence[Part], dowels: Sequence[Pin]) -> Check:
    """Check that the dowels, in the middle of their sockets, touch neither piece."""
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in pieces]
    worst = 0.0
    for dowel in dowels:
        start = dowel.center - dowel.length / 2 * dowel.axis
        rod = triangle_kernel.union([triangle_kernel.solid_of(t) for t in dowel.shape])
        rod = rod.transform(np.column_stack([axes_from_normal(dowel.axis), start]))
        what = f"the dowel of {dowel.diameter:g} mm between the pieces of {part.name}"
        worst = max(worst, *(check_overlap(rod, s, what, REMEDY) for s in solids))
    return Check(f"dowels in the solid of {part.name}", worst, MAX_OVERLAP_MM3, "mm3", "")


def find_crossed_channels(
    part_set: PartSet, part: Part, plane: Plane, rules: PartRules
) -> dict[str, tuple[Float, float]]:
    """Return the channels that a plane cuts in a part.

    Returns:
        For each cord or wire, by its name: the center line (n, 3) near the cut, and its radius, mm.
    """
    channels = {}
    for what, line, radius, hollow in _channel_lines(part_set, rules):
        height = (line - plane.origin) @ plane.normal
        at = np.flatnonzero((height[1:] > 0) != (height[:-1] > 0))
        # The facets of this part include the walls, or one half of them, of its channels.
        distance = signed_distance_of(part.surface).unsigned(line[at]) if len(at) else np.zeros(0)
        crossings = at[distance < hollow + rules.inner_wall / 2]
        if len(crossings):
            distance = np.linalg.norm(line[:, None] - line[crossings], axis=2).min(axis=1)
            channels[what] = (line[distance < CROSSING_LENGTH_MM], radius)
    return channels


def check_crossings(
    part_set: PartSet, part: Part, pieces: Sequence[Part], plane: Plane, rules: PartRules
) -> list[Check]:
    """Check that every channel that the cut crosses continues behind it.

    In both pieces there must be as much room around the cord or wire as it is thick.
    """
    checks = []
    for what, (line, radius) in find_crossed_channels(part_set, part, plane, rules).items():
        room = np.min([-signed_distance_of(p.surface)(line) for p in pieces], axis=0)
        k = int(room.argmin())
        name = f"room around {what} where {part.name} is cut across"
        limit, at = radius - FACET_TOLERANCE_MM, format_point(line[k])
        check = Check(name, float(room[k]), limit, "mm", at, at_least=True)
        checks.append(
            check.require(radius, "channel-blocked", REMEDY, what=what, room=float(room[k]))
        )
    return checks


def _channel_lines(
    part_set: PartSet, rules: PartRules
) -> Iterator[tuple[str, Float, float, float]]:
    """Yield each cord or wire, its channel's center line (n, 3), and the radii of both, mm."""
    wires = rules.pockets.wires if rules.pockets else None
    for channel in part_set.channels:
        yield f"cord {channel.name}", channel.inside, rules.cord / 2, rules.channel / 2
        for end, which in zip(channel.ends, ("start", "end"), strict=True):
            if end.lead and wires:
                what = f"the wire at the {which} of cord {channel.name}"
                yield what, end.lead.inside, wires.wire / 2, wires.diameter / 2
