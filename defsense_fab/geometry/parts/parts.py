"""Make printable parts from a body and its cords: grooved, pinned, numbered and checked."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.arrays import Float, format_point
from ...core.device.device import Sensor
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..bodies.connector_bay import without_bay
from ..bodies.orientation import Z_UP, viewing_axes
from ..bodies.regions import KEPT_SPACING_MM, fill_region
from ..channels.cord_channels import Channel, make_channels
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism
from ..printing.print_bed import choose_side_down
from . import alignment_pins, engraving, part_checks
from .channel_openings import ChannelOpening
from .division import SMALL_PART_SHARE, Cut, Division, divide_body, plan_division
from .part_checks import check_parts
from .part_contacts import Contact, find_contacts
from .records import Part, PartRules, PartSet, outward_normals
from .wall_checks import check_cord_walls, check_wire_walls

#: Words from low to high to the right, up, and away from the viewer.
_WORDS = (("left", "right"), ("bottom", "top"), ("front", "back"))
_ORDINALS = ("second", "third", "fourth", "fifth", "sixth", "seventh")
LEVEL_GAP_SHARE = 0.08  # of the body's size: nearer parts share a level
FINER_GAP_SHARES = (0.06, 0.04, 0.02, 0.01)  # until the words of all parts differ
MAX_LEVELS = 2 * len(_ORDINALS) + 3  # for which there are words


def part_names(centers: Sequence[Float], bounds: Float, frame: Float = Z_UP) -> list[str]:
    """Name parts by where they lie in the device, as in "3-top-left".

    Args:
        centers: Center of mass (3,) of each part, mm.
        bounds: Bounding box (2, 3) of the body, mm.
        frame: Viewing axes (3, 3) of the body (`geometry.bodies.orientation`).

    Returns:
        For each part its number, counted from the bottom up, and its place as seen by a viewer.
    """
    points = _view(centers, frame)
    size = np.abs(frame) @ np.ptp(bounds, axis=0)
    rows = _place_words(points, LEVEL_GAP_SHARE * size)
    for gap_share in FINER_GAP_SHARES:
        if len(set(rows)) == len(rows):
            break
        rows = _place_words(points, gap_share * size)
    out = [""] * len(points)
    for n, i in enumerate(_number_parts(centers, frame)):
        out[i] = "-".join([str(n + 1), *_distinguish(rows, i)])
    return out


def _view(centers: Sequence[Float], frame: Float) -> Float:
    """Return points (n, 3) to the right, up, and away from a viewer, mm."""
    view = frame * np.array([[1.0], [1], [-1]])
    return np.asarray(np.array(centers).reshape(-1, 3) @ view.T)


def _number_parts(centers: Sequence[Float], frame: Float) -> list[int]:
    """Return the indices of parts from the bottom up, then from front to back and left to right."""
    rank = np.round(_view(centers, frame)[:, [1, 2, 0]], 3)
    return sorted(range(len(rank)), key=lambda i: tuple(rank[i]))


def _distinguish(rows: Sequence[tuple[str, ...]], i: int) -> tuple[str, ...]:
    """Return as few of a part's words as distinguish it from all others, or all of them; "middle"
    only if no other word does.
    """
    if len(rows) == 1:
        return ("whole",)
    sets = [c for size in (1, 2, 3) for c in itertools.combinations(range(3), size)]
    for excluded in (("", "middle"), ("",)):
        for axes in sets:
            words = tuple(rows[i][a] for a in axes)
            is_unique = sum(words == tuple(r[a] for a in axes) for r in rows) == 1
            if is_unique and not set(words) & set(excluded):
                return words
    return tuple(w for w in rows[i] if w) or ("middle",)


def _place_words(points: Float, gaps: Float) -> list[tuple[str, ...]]:
    """Return the words of each point (n, 3) for its height, its depth and its side."""
    words = [_level_words(points[:, axis], float(gaps[axis]), axis) for axis in (1, 2, 0)]
    return list(zip(*words, strict=True))


def _level_words(values: Float, gap: float, axis: int) -> list[str]:
    """Return the word for each coordinate; levels are separated by gaps."""
    sort = np.argsort(values)
    level = np.zeros(len(values), int)
    level[sort] = np.concatenate([[0], np.cumsum(np.diff(values[sort]) > gap)])
    count = int(level.max()) + 1
    if count > MAX_LEVELS:
        return _level_words(values, 2 * gap, axis)
    if count == 1:
        return [""] * len(values)
    words = _words_of_levels(count, *_WORDS[axis])
    return [words[k] for k in level]


def _words_of_levels(count: int, low: str, high: str) -> list[str]:
    """Return the words of some levels, counted from the nearer end."""
    if (count, low) == (4, "bottom"):
        return ["bottom", "lower-middle", "upper-middle", "top"]
    ordinals = [_ORDINALS[k] for k in range(count // 2 - 1)]
    return [
        low,
        *(f"{n}-from-{low}" for n in ordinals),
        *(["middle"] if count % 2 else []),
        *(f"{n}-from-{high}" for n in reversed(ordinals)),
        high,
    ]


def make_parts(
    surface: Surface,
    sensors: Sequence[Sensor],
    rules: PartRules,
    report: Callable[[float, str], None] = lambda *_: None,
    solid: Any = None,
    channels: Sequence[Channel] | None = None,
) -> PartSet:
    """Divide a body along its cords' planes into parts that can be printed and assembled.

    manifold3d cuts the facets; with `solid` OpenCascade makes the same parts, and both must agree.

    Args:
        surface: Surface of the body.
        sensors: The cords.
        rules: Rules of the parts.
        report: Called with the share of the work that is done and its step.
        solid: The body's TopoDS_Solid, or None.
        channels: The cords' channels by these rules, if they are known.

    Raises:
        FabricationError: If a part cannot be made or fails a check, with the cord or part and the
            place.
    """
    report(0.05, "cutting facets")
    body = triangle_kernel.to_manifold(surface, "the body")
    _check_one_solid(body)
    if channels is None:
        channels = make_channels(sensors, surface, rules.channel, rules.inner_wall, rules.pockets)
    wall_checks = [
        *check_cord_walls(channels, surface, rules),
        *check_wire_walls(channels, surface, rules),
    ]
    hollows = [h for c in channels for h in c.hollows(rules.channel, rules.pockets)]
    hollows += [(fill_region(shape, KEPT_SPACING_MM), KEPT_SPACING_MM) for shape in rules.kept]
    bay = _bay_of(rules)
    skin = without_bay(surface, bay) if bay else surface
    planes = [s.plane for s in sensors]
    seats = engraving.place_seats(skin, rules.seats, rules.tag, hollows, rules.wall, planes)
    flattened = triangle_kernel.cut_out(body, [t for s in seats for t in s.tools])
    if seats:
        surface = triangle_kernel.to_surface(flattened)
    division, names, openings = _divide(flattened, channels, surface, rules)
    report(0.25, "pins and numbers")
    contacts = find_contacts(division, hollows)
    pins = alignment_pins.place_pins(contacts, rules.clearance, rules.inner_wall)
    labels = engraving.engrave_numbers(contacts, pins, len(names), rules.inner_wall)
    part_set = PartSet(
        parts=(),
        cuts=division.cuts,
        contacts=tuple(contacts),
        pins=tuple(pins),
        labels=tuple(labels),
        seats=tuple(seats),
        channels=tuple(channels),
        checks=(),
        warnings={},
        cut_out=0.0,
        body_volume=float(body.volume()),
        rules=rules,
        bare=division.leaves,
        carved=division.parts,
        openings=tuple(openings),
    )
    pieces = [triangle_kernel.cut_out(p, part_set.tools(i)) for i, p in enumerate(division.parts)]
    parts = [_make_part(i, names[i], p, contacts, division.leaves[i]) for i, p in enumerate(pieces)]
    removed = part_set.body_volume - float(flattened.volume()) + division.removed
    part_set = replace(part_set, parts=tuple(parts), cut_out=removed + _volume_of_tools(part_set))
    report(0.4, "checking")
    checks = check_parts(part_set, pieces, surface, rules)
    part_set = replace(part_set, checks=(*wall_checks, *checks))
    part_set = part_set.with_warnings(_warnings(part_set, rules))
    if solid is None:
        return part_set
    report(0.6, "cutting the solid")
    return add_solids(part_set, solid)


def add_solids(part_set: PartSet, solid: Any) -> PartSet:
    """Return the result of `exact_solids.add_solids`, which needs a kernel that loads slowly."""
    from . import exact_solids

    return exact_solids.add_solids(part_set, solid)


def _volume_of_tools(part_set: PartSet) -> float:
    """Return the volume that sockets and numbers take from the parts, mm^3."""
    volume = 0.0
    for i, part in enumerate(part_set.carved):
        if tools := part_set.tools(i):
            solids = [triangle_kernel.solid_of(t) for t in tools]
            volume += float((part ^ triangle_kernel.union(solids)).volume())
    return volume


def _bay_of(rules: PartRules) -> Prism | None:
    """Return the connector bay that wires lead to."""
    return rules.pockets.wires.bay if rules.pockets and rules.pockets.wires else None


def _check_one_solid(body: Any) -> None:
    """Raise FabricationError if the body has cavities or separate pieces."""
    pieces = body.decompose()
    for piece in sorted(pieces, key=lambda p: float(p.volume()))[:-1]:
        middle = triangle_kernel.to_surface(piece).centroid
        at = format_point(middle)
        raise FabricationError(
            f"the body has a closed cavity near {at}"
            if piece.volume() < 0
            else f"the body has a separate piece near {at}; unite the pieces or remove it",
            code="closed-cavity" if piece.volume() < 0 else "separate-pieces",
            at=middle.tolist(),
        )


def _divide(
    body: Any, channels: Sequence[Channel], surface: Surface, rules: PartRules
) -> tuple[Division, list[str], list[ChannelOpening]]:
    """Divide a body.

    Returns:
        The division with the parts in the order of their numbers; their names; and where channels
        open into joints.
    """
    radius, wall = rules.channel / 2, rules.inner_wall
    plan = plan_division(
        body, channels, radius, wall, rules.clearance, rules.limit, rules.through, rules.across
    )
    openings = plan.find_openings(channels, radius, wall)
    division = divide_body(body, channels, plan)
    centers = [triangle_kernel.to_surface(p).centroid for p in division.parts]
    frame = viewing_axes(surface)
    names, order = part_names(centers, surface.bounds, frame), _number_parts(centers, frame)
    index = np.argsort(order).tolist()

    def renumber(side: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(sorted(index[i] for i in side))

    cuts = tuple(
        replace(c, sides=(renumber(c.sides[0]), renumber(c.sides[1]))) for c in division.cuts
    )
    parts, leaves = (tuple(of[i] for i in order) for of in (division.parts, division.leaves))
    division = replace(division, parts=parts, leaves=leaves, cuts=cuts)
    return division, [names[i] for i in order], openings


def _make_part(i: int, name: str, piece: Any, contacts: Sequence[Contact], bare: Any) -> Part:
    """Return a part; `bare` is its solid without channels, sockets and numbers."""
    faces = [
        (c.plane.normal if c.lower == i else -c.plane.normal, c.plane.origin)
        for c in contacts
        if i in (c.lower, c.upper)
    ]
    surface = triangle_kernel.to_printable_surface(
        piece, name, [(n, float(n @ origin)) for n, origin in faces]
    )
    down = choose_side_down(surface, outward_normals(contacts, i), bare)
    return Part(name, surface, surface.volume, surface.centroid, down)


def _warnings(part_set: PartSet, rules: PartRules) -> dict[str, Float | None]:
    """Return what a maker should know of the parts, with the points (3,) mm concerned."""
    out = {check.note: check.point for check in part_set.checks if check.note}
    if len(part_set.seats) < rules.seats:
        out[
            f"{len(part_set.seats)} of {rules.seats} marker seats of {rules.tag:g} mm fit: the"
            " rest of the skin is curved, close to an edge, or thin above a cord"
        ] = None
    ends = [
        (c, e, n) for c in part_set.channels for e, n in zip(c.ends, ("start", "end"), strict=True)
    ]
    if _bay_of(rules):
        out |= {
            f"the wire at the {which} of cord {channel.name}, near {format_point(end.mouth)}, does"
            f" not reach the connector bay: {end.reason or end.unled}": end.mouth
            for channel, end, which in ends
            if end.wire != "bay"
        }
    for opening in part_set.openings:
        joint = _cut_name(part_set.cuts[opening.cut], part_set.channels)
        what = "opens into" if opening.wall <= 0 else f"leaves {opening.wall:.1f} mm of wall to"
        length = max(opening.length, 1.0)
        out[
            f"the channel of cord {part_set.channels[opening.line].name!r} {what} the joint of"
            f" {joint} over {length:.0f} mm near {format_point(opening.at)}: keep glue away"
            " from it there"
        ] = opening.at
    for i, part in enumerate(part_set.parts):
        if part.volume < SMALL_PART_SHARE * part_set.body_volume:
            text = f"{part.name} is small ({part.volume:.0f} mm3): two cord planes lie close"
            out[text] = part.center
        out |= part_checks.part_notes(part_set, i)
    # A joint that divides several parts belongs to several cuts, and is noted once.
    return out | part_checks.joint_notes(part_set)


def _cut_name(cut: Cut, channels: Sequence[Channel]) -> str:
    """Return the cords of a cut."""
    return " and ".join(repr(channels[c].name) for c in cut.cords)
