"""Make printable parts from a body and its cords: grooved, pinned, numbered and checked."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...core.arrays import Float, format_point
from ...core.device.device import Sensor
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..bodies.connector_bay import without_bay
from ..bodies.orientation import Z_UP, viewing_axes
from ..channels.cord_channels import Channel, make_channels
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism, Tool
from ..printing.print_bed import choose_side_down
from . import alignment_pins, engraving, part_checks
from .channel_openings import ChannelOpening
from .division import SMALL_PART_SHARE, Cut, Division, divide_body, plan_division
from .engraving import Label
from .part_checks import check_parts
from .part_contacts import Contact, find_contacts
from .records import Part, PartRules, PartSet
from .wall_checks import check_cord_walls, check_wire_walls

#: Words from low to high to the right, up, and away from the viewer.
_WORDS = (("left", "right"), ("bottom", "top"), ("front", "back"))
_ORDINALS = ("second", "third", "fourth", "fifth", "sixth", "seventh")
LEVEL_GAP_SHARE = (
    0.08  # of the body's size: nearer parts share a level, of which there are 13 at most
)


def part_names(centers: Sequence[Float], bounds: Float, frame: Float = Z_UP) -> list[str]:
    """Name parts by where they lie in the device, as in "3-top-left".

    Args:
        centers: Center of mass (3,) of each part, mm.
        bounds: Bounding box (2, 3) of the body, mm.
        frame: Viewing axes (3, 3) of the body (`geometry.bodies.orientation`).

    Returns:
        For each part its number, counted from the bottom up, and its place as seen by a viewer.
    """
    view = frame * np.array([[1.0], [1], [-1]])
    points = np.array(centers).reshape(-1, 3) @ view.T
    size = np.abs(frame) @ np.ptp(bounds, axis=0)
    rank = np.round(points[:, [1, 2, 0]], 3)
    order = sorted(range(len(points)), key=lambda i: tuple(rank[i]))
    words = [_level_words(points[:, axis], float(size[axis]), axis) for axis in (1, 2, 0)]
    rows = list(zip(*words, strict=True))
    out = [""] * len(points)
    for n, i in enumerate(order):
        out[i] = "-".join([str(n + 1), *_distinguish(rows, i)])
    return out


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


def _level_words(values: Float, size: float, axis: int) -> list[str]:
    """Return the word for each coordinate; levels are separated by gaps."""
    sort = np.argsort(values)
    level = np.zeros(len(values), int)
    level[sort] = np.concatenate([[0], np.cumsum(np.diff(values[sort]) > LEVEL_GAP_SHARE * size)])
    count = int(level.max()) + 1
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
) -> PartSet:
    """Divide a body along its cords' planes into parts that can be printed and assembled.

    manifold3d cuts the facets; with `solid` OpenCascade makes the same parts, and both must agree.

    Args:
        surface: Surface of the body.
        sensors: The cords.
        rules: Rules of the parts.
        report: Called with the share of the work that is done and its step.
        solid: The body's TopoDS_Solid, or None.

    Raises:
        FabricationError: If a part cannot be made or fails a check, with the cord or part and the
            place.
    """
    report(0.05, "cutting facets")
    body = triangle_kernel.to_manifold(surface, "the body")
    _check_one_solid(body)
    channels = make_channels(sensors, surface, rules.channel, rules.inner_wall, rules.pockets)
    wall_checks = [
        *check_cord_walls(channels, surface, rules),
        *check_wire_walls(channels, surface, rules),
    ]
    body_volume = float(body.volume())
    hollows = [h for c in channels for h in c.hollows(rules.channel, rules.pockets)]
    planes = [s.plane for s in sensors]
    bay = _bay_of(rules)
    skin = without_bay(surface, bay) if bay else surface
    seats = engraving.place_seats(skin, rules.seats, rules.tag, hollows, rules.wall, planes)
    seat_tools = [t for s in seats for t in s.tools]
    if seat_tools:
        body = triangle_kernel.cut_out(body, seat_tools)
        surface = triangle_kernel.to_surface(body)
    radius, inner = rules.channel / 2, rules.inner_wall
    planned = plan_division(
        body, channels, radius, inner, rules.clearance, rules.limit, rules.through, rules.across
    )
    openings = planned.find_openings(channels, radius, inner)
    division, names = _order_parts(divide_body(body, channels, planned), surface)
    report(0.25, "pins and numbers")
    contacts_found = find_contacts(division, hollows)
    pins = alignment_pins.place_pins(contacts_found, rules.clearance, rules.inner_wall)
    labels = engraving.engrave_numbers(contacts_found, pins, len(names), rules.inner_wall)
    tools_of_parts = _part_tools(len(names), contacts_found, pins, labels)
    pieces = [
        triangle_kernel.cut_out(p, tools)
        for p, tools in zip(division.parts, tools_of_parts, strict=True)
    ]
    removed = body_volume - float(body.volume()) + division.removed
    removed += sum(
        float((p ^ triangle_kernel.union([triangle_kernel.solid_of(t) for t in tools])).volume())
        for p, tools in zip(division.parts, tools_of_parts, strict=True)
        if tools
    )
    parts = [
        _make_part(i, n, p, contacts_found)
        for i, (n, p) in enumerate(zip(names, pieces, strict=True))
    ]
    report(0.4, "checking")
    part_set = PartSet(
        tuple(parts),
        division.cuts,
        tuple(contacts_found),
        tuple(pins),
        tuple(labels),
        tuple(seats),
        tuple(channels),
        (),
        (),
        removed,
        body_volume,
        division.leaves,
    )
    checks_found = check_parts(part_set, pieces, surface, rules)
    part_set = replace(part_set, checks=(*wall_checks, *checks_found))
    part_set = replace(part_set, warnings=tuple(_warnings(part_set, openings, rules)))
    part_set = replace(
        part_set, exact=partial(_add_solids, seat_tools, division, tools_of_parts, rules)
    )
    if solid is None:
        return part_set
    report(0.6, "cutting the solid")
    return add_solids(part_set, solid)


def add_solids(made: PartSet, solid: Any) -> PartSet:
    """Return the parts of `make_parts` with their exact solids.

    Args:
        made: Parts, as `make_parts` returned them.
        solid: TopoDS_Solid of the body.

    Returns:
        The same parts with solids; without them and with a warning where OpenCascade fails, as the
        STL files do not need them.
    """
    assert made.exact is not None
    return made.exact(made, solid)


def _add_solids(
    flattening: Sequence[Tool],
    division: Division,
    own: Sequence[Sequence[Tool]],
    rules: PartRules,
    made: PartSet,
    solid: Any,
) -> PartSet:
    from .exact_solids import add_solids, carve_solid

    try:
        parts = add_solids(carve_solid(solid, flattening), made, division, own, rules)
    except FabricationError as error:
        return replace(made, warnings=(*made.warnings, f"no STEP parts: {error}"))
    return replace(made, parts=tuple(parts))


def _bay_of(rules: PartRules) -> Prism | None:
    """Return the connector bay that wires lead to."""
    return rules.pockets.wires.bay if rules.pockets and rules.pockets.wires else None


def _check_one_solid(body: Any) -> None:
    """Raise FabricationError if the body has cavities or separate pieces."""
    pieces = body.decompose()
    for piece in sorted(pieces, key=lambda p: float(p.volume()))[:-1]:
        middle = triangle_kernel.centroid(triangle_kernel.to_surface(piece))
        at = format_point(middle)
        raise FabricationError(
            f"the body has a closed cavity near {at}"
            if piece.volume() < 0
            else f"the body has a separate piece near {at}; unite the pieces or remove it",
            code="closed-cavity" if piece.volume() < 0 else "separate-pieces",
            at=middle.tolist(),
        )


def _order_parts(division: Division, surface: Surface) -> tuple[Division, list[str]]:
    """Return the division with the parts in the order of their numbers, and their names."""
    centers = [triangle_kernel.centroid(triangle_kernel.to_surface(p)) for p in division.parts]
    names = part_names(centers, surface.bounds, viewing_axes(surface))
    order = sorted(range(len(names)), key=lambda i: int(names[i].split("-")[0]))
    index = np.argsort(order).tolist()

    def renumber(side: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(sorted(index[i] for i in side))

    cuts = tuple(
        replace(c, sides=(renumber(c.sides[0]), renumber(c.sides[1]))) for c in division.cuts
    )
    parts, leaves = (tuple(of[i] for i in order) for of in (division.parts, division.leaves))
    return replace(division, parts=parts, leaves=leaves, cuts=cuts), [names[i] for i in order]


def _make_part(i: int, name: str, piece: Any, contacts_found: Sequence[Contact]) -> Part:
    faces = [
        (c.area, c.plane.normal if c.lower == i else -c.plane.normal, c.plane.origin)
        for c in contacts_found
        if i in (c.lower, c.upper)
    ]
    surface = triangle_kernel.to_printable_surface(
        piece, name, [(n, float(n @ origin)) for _, n, origin in faces]
    )
    down = choose_side_down(surface, [n for _, n, _ in sorted(faces, key=lambda f: -f[0])])
    return Part(name, surface, surface.volume, triangle_kernel.centroid(surface), down)


def _part_tools(
    count: int,
    contacts_found: Sequence[Contact],
    pins: Sequence[alignment_pins.Pin],
    labels: Sequence[Label],
) -> list[list[Tool]]:
    """Return the tools that cut each part alone: sockets and its number."""
    tools_of_parts: list[list[Tool]] = [[] for _ in range(count)]
    for pin in pins:
        contact = contacts_found[pin.contact]
        tools_of_parts[contact.lower].append(pin.socket_in(upper=False))
        tools_of_parts[contact.upper].append(pin.socket_in(upper=True))
    for label in labels:
        tools_of_parts[label.part] += label.tools
    return tools_of_parts


def _warnings(part_set: PartSet, openings: Sequence[ChannelOpening], rules: PartRules) -> list[str]:
    """Return what a maker should know of the parts."""
    out = [check.note for check in part_set.checks if check.note]
    if len(part_set.seats) < rules.seats:
        out.append(
            f"{len(part_set.seats)} of {rules.seats} marker seats of {rules.tag:g} mm"
            f" fit: the rest of"
            " the skin is curved, close to an edge, or thin above a cord"
        )
    ends = [
        (c, e, n) for c in part_set.channels for e, n in zip(c.ends, ("start", "end"), strict=True)
    ]
    if _bay_of(rules):
        out += [
            f"the wire at the {which} of cord {channel.name}, near {format_point(end.mouth)},"
            f" does not"
            f" reach the connector bay: {end.reason or end.unled}"
            for channel, end, which in ends
            if end.wire != "bay"
        ]
    for opening in openings:
        joint = _cut_name(part_set.cuts[opening.cut], part_set.channels)
        what = "opens into" if opening.wall <= 0 else f"leaves {opening.wall:.1f} mm of wall to"
        out.append(
            f"the channel of cord {part_set.channels[opening.line].name!r} {what} the joint of"
            f" {joint} over"
            f" {opening.length:.0f} mm near {format_point(opening.at)}: keep glue away from it"
            f" there"
        )
    for i, part in enumerate(part_set.parts):
        if part.volume < SMALL_PART_SHARE * part_set.body_volume:
            out.append(f"{part.name} is small ({part.volume:.0f} mm^3): two cord planes lie close")
        out += part_checks.part_notes(part_set, i)
    out += part_checks.joint_notes(part_set)
    return list(dict.fromkeys(out))  # a joint that divides several parts belongs to several cuts


def _cut_name(cut: Cut, channels: Sequence[Channel]) -> str:
    """Return the cords of a cut."""
    return " and ".join(repr(channels[c].name) for c in cut.cords)
