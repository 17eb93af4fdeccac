"""From a body and its cords to printable parts: grooved, pinned, numbered and checked."""

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
from ..bodies.orientation import Z_UP, standing
from ..channels.cord_channels import Channel, make_channels
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism, Tool
from ..printing.print_bed import resting
from . import alignment_pins, engraving, part_checks
from .channel_openings import ChannelOpening
from .division import SMALL, Cut, Division, divide, plan
from .engraving import Label
from .part_checks import inspect
from .part_contacts import Contact, contacts
from .records import PartSet, Part, PartRules
from .wall_checks import walls, wire_walls

# Names of parts by where they lie in the device.

#: Words from low to high along what is to the right, up, and away from the viewer.
_WORDS = (("left", "right"), ("bottom", "top"), ("front", "back"))
_ORDINALS = ("second", "third", "fourth", "fifth", "sixth", "seventh")
_SAME = 0.08  # of the body's size: parts nearer than this are on one level: 13 at most


def part_names(centers: Sequence[Float], bounds: Float, frame: Float = Z_UP) -> list[str]:
    """A name for each part's centre of mass (3,) mm in a body with `bounds` (2, 3) mm: its number,
    counted from the bottom up, and where it lies for who sees the body as `frame` (3, 3) says
    (`geometry.bodies.standing`), as in "3-top-left"."""
    seen = frame * np.array([[1.0], [1], [-1]])
    points = np.array(centers).reshape(-1, 3) @ seen.T
    size = np.abs(frame) @ np.ptp(bounds, axis=0)
    rank = np.round(points[:, [1, 2, 0]], 3)
    order = sorted(range(len(points)), key=lambda i: tuple(rank[i]))
    words = [_levels(points[:, axis], float(size[axis]), axis) for axis in (1, 2, 0)]
    rows = list(zip(*words, strict=True))
    out = [""] * len(points)
    for n, i in enumerate(order):
        out[i] = "-".join([str(n + 1), *_told_apart(rows, i)])
    return out


def _told_apart(rows: Sequence[tuple[str, ...]], i: int) -> tuple[str, ...]:
    """As few of a part's words as tell it from all others, or all of them; "middle" where no
    other word does."""
    if len(rows) == 1:
        return ("whole",)
    sets = [c for size in (1, 2, 3) for c in itertools.combinations(range(3), size)]
    for vague in (("", "middle"), ("",)):
        for some in sets:
            own = tuple(rows[i][a] for a in some)
            alone = sum(own == tuple(r[a] for a in some) for r in rows) == 1
            if alone and not set(own) & set(vague):
                return own
    return tuple(w for w in rows[i] if w) or ("middle",)


def _levels(values: Float, size: float, axis: int) -> list[str]:
    """The word for each coordinate: levels are separated by gaps."""
    sort = np.argsort(values)
    level = np.zeros(len(values), int)
    level[sort] = np.concatenate([[0], np.cumsum(np.diff(values[sort]) > _SAME * size)])
    count = int(level.max()) + 1
    if count == 1:
        return [""] * len(values)
    words = _steps(count, *_WORDS[axis])
    return [words[k] for k in level]


def _steps(count: int, low: str, high: str) -> list[str]:
    """The words of so many levels, counted from the nearer end, as one does who looks at them."""
    if (count, low) == (4, "bottom"):
        return ["bottom", "lower-middle", "upper-middle", "top"]
    half = [_ORDINALS[k] for k in range(count // 2 - 1)]
    return [
        low,
        *(f"{n}-from-{low}" for n in half),
        *(["middle"] if count % 2 else []),
        *(f"{n}-from-{high}" for n in reversed(half)),
        high,
    ]


def make_parts(
    surface: Surface,
    sensors: Sequence[Sensor],
    rules: PartRules,
    report: Callable[[float, str], None] = lambda *_: None,
    solid: Any = None,
) -> PartSet:
    """Divide the body along its cords' planes into parts that can be printed and put together.

    The facets are cut by manifold3d; with `solid` (the body's TopoDS_Solid) OpenCascade makes the
    same parts, and both must agree. Raises FabricationError where a part cannot be made or fails
    a check, with the cord or part and the place.
    """
    report(0.05, "cutting facets")
    body = triangle_kernel.to_manifold(surface, "the body")
    _one_solid(body)
    channels = make_channels(sensors, surface, rules.channel, rules.inner_wall, rules.pockets)
    around = [*walls(channels, surface, rules), *wire_walls(channels, surface, rules)]
    body_volume = float(body.volume())
    hollows = [h for c in channels for h in c.hollows(rules.channel, rules.pockets)]
    planes = [s.plane for s in sensors]
    bay = _bay(rules)
    skin = without_bay(surface, bay) if bay else surface
    flats = engraving.place_seats(skin, rules.seats, rules.tag, hollows, rules.wall, planes)
    flattening = [t for s in flats for t in s.tools]
    if flattening:
        body = triangle_kernel.without(body, flattening)
        surface = triangle_kernel.to_surface(body)
    radius, inner = rules.channel / 2, rules.inner_wall
    planned = plan(
        body, channels, radius, inner, rules.clearance, rules.limit, rules.through, rules.across
    )
    grazing = planned.grazes(channels, radius, inner)
    division, names = _named(divide(body, channels, planned), surface)
    report(0.25, "pins and numbers")
    meeting = contacts(division, hollows)
    pins = alignment_pins.place_pins(meeting, rules.clearance, rules.inner_wall)
    marks = engraving.engrave(meeting, pins, len(names), rules.inner_wall)
    own = _own_tools(len(names), meeting, pins, marks)
    pieces = [
        triangle_kernel.without(p, tools) for p, tools in zip(division.parts, own, strict=True)
    ]
    removed = body_volume - float(body.volume()) + division.removed
    removed += sum(
        float((p ^ triangle_kernel.union([triangle_kernel.solid_of(t) for t in tools])).volume())
        for p, tools in zip(division.parts, own, strict=True)
        if tools
    )
    parts = [_part(i, n, p, meeting) for i, (n, p) in enumerate(zip(names, pieces, strict=True))]
    report(0.4, "checking")
    made = PartSet(
        tuple(parts), division.cuts, tuple(meeting), tuple(pins), tuple(marks), tuple(flats),
        tuple(channels), (), (), removed, body_volume, division.leaves,
    )  # fmt: skip
    found = inspect(made, pieces, surface, rules)
    made = replace(made, checks=(*around, *found))
    made = replace(made, warnings=tuple(_warnings(made, grazing, rules)))
    if solid is None:
        return made
    report(0.6, "cutting the solid")
    from .exact_solids import carved, solid_parts

    try:
        parts = solid_parts(carved(solid, flattening), made, division, own, rules)
    except FabricationError as error:  # the STL do not need it
        return replace(made, warnings=(*made.warnings, f"no STEP parts: {error}"))
    return replace(made, parts=tuple(parts))


def _bay(rules: PartRules) -> Prism | None:
    """The connector bay that wires lead to."""
    return rules.pockets.wires.bay if rules.pockets and rules.pockets.wires else None


def _one_solid(body: Any) -> None:
    pieces = body.decompose()
    for piece in sorted(pieces, key=lambda p: float(p.volume()))[:-1]:
        middle = triangle_kernel.centroid(triangle_kernel.to_surface(piece))
        at = format_point(middle)
        raise FabricationError(
            f"the body has a closed cavity near {at}; open it to the outside or fill it"
            if piece.volume() < 0
            else f"the body has a separate piece near {at}; unite the pieces or remove it",
            code="closed-cavity" if piece.volume() < 0 else "separate-pieces",
            at=middle.tolist(),
        )


def _named(division: Division, surface: Surface) -> tuple[Division, list[str]]:
    """The parts in the order of their numbers, with their names."""
    centers = [triangle_kernel.centroid(triangle_kernel.to_surface(p)) for p in division.parts]
    names = part_names(centers, surface.bounds, standing(surface))
    order = sorted(range(len(names)), key=lambda i: int(names[i].split("-")[0]))
    index = np.argsort(order).tolist()

    def moved(side: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(sorted(index[i] for i in side))

    cuts = tuple(replace(c, sides=(moved(c.sides[0]), moved(c.sides[1]))) for c in division.cuts)
    parts, leaves = (tuple(of[i] for i in order) for of in (division.parts, division.leaves))
    return replace(division, parts=parts, leaves=leaves, cuts=cuts), [names[i] for i in order]


def _part(i: int, name: str, piece: Any, meeting: Sequence[Contact]) -> Part:
    faces = [
        (c.area, c.plane.normal if c.lower == i else -c.plane.normal, c.plane.origin)
        for c in meeting
        if i in (c.lower, c.upper)
    ]
    surface = triangle_kernel.printable(
        piece, name, [(n, float(n @ origin)) for _, n, origin in faces]
    )
    down = resting(surface, [n for _, n, _ in sorted(faces, key=lambda f: -f[0])])
    return Part(name, surface, surface.volume, triangle_kernel.centroid(surface), down)


def _own_tools(
    count: int,
    meeting: Sequence[Contact],
    pins: Sequence[alignment_pins.Pin],
    marks: Sequence[Label],
) -> list[list[Tool]]:
    """What is cut out of each part alone: sockets and its number."""
    own: list[list[Tool]] = [[] for _ in range(count)]
    for pin in pins:
        contact = meeting[pin.contact]
        own[contact.lower].append(pin.socket_in(upper=False))
        own[contact.upper].append(pin.socket_in(upper=True))
    for mark in marks:
        own[mark.part] += mark.tools
    return own


def _warnings(made: PartSet, grazing: Sequence[ChannelOpening], rules: PartRules) -> list[str]:
    """What a maker should know of the parts."""
    out = [check.note for check in made.checks if check.note]
    if len(made.seats) < rules.seats:
        out.append(
            f"{len(made.seats)} of {rules.seats} marker seats of {rules.tag:g} mm fit: the rest of"
            " the skin is curved, close to an edge, or thin above a cord"
        )
    ends = [(c, e, n) for c in made.channels for e, n in zip(c.ends, ("start", "end"), strict=True)]
    if _bay(rules):
        out += [
            f"the wire at the {which} of cord {channel.name}, near {format_point(end.mouth)}, does not"
            f" reach the connector bay: {end.reason or end.unled}"
            for channel, end, which in ends
            if end.wire != "bay"
        ]
    for g in grazing:
        joint = _cut_name(made.cuts[g.cut], made.channels)
        what = "opens into" if g.wall <= 0 else f"leaves {g.wall:.1f} mm of wall to"
        out.append(
            f"the channel of cord {made.channels[g.line].name!r} {what} the joint of {joint} over"
            f" {g.length:.0f} mm near {format_point(g.at)}: keep glue away from it there"
        )
    for i, part in enumerate(made.parts):
        if part.volume < SMALL * made.body_volume:
            out.append(f"{part.name} is small ({part.volume:.0f} mm^3): two cord planes lie close")
        out += part_checks.of_part(made, i)
    out += part_checks.of_joints(made)
    return list(dict.fromkeys(out))  # a joint is of several cuts where it divides several parts


def _cut_name(cut: Cut, channels: Sequence[Channel]) -> str:
    """The cords that a cut is for."""
    return " and ".join(repr(channels[c].name) for c in cut.cords)
