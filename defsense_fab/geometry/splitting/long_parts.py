"""Parts too long for the bed are cut across, and joined by two dowels before all else.

The cut is planar and across the part as it lies on the bed. It keeps away from pins, from the ends
of cords with their pockets, and from numbers; a groove that it crosses goes on straight behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, xyz
from ...core.curve import Plane
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism, frame
from ..parts.alignment_pins import Pin, place_pins
from ..parts.division import Cut
from ..parts.part_contacts import Contact
from ..parts.records import Made, Part, Rules
from ..parts.tag_seats import Seat
from ..printing.print_bed import fits, laid

#: Pieces beyond which a part is not cut up.
MOST = 6
_STEP = 1.0  # mm, between the places that are tried
_CLEAR = 2.0  # mm, from pins, ends of cords and numbers
_SHORTEST = 25.0  # mm, of a piece
_BESIDE, _HALF = 0.02, 1e4


@dataclass(frozen=True)
class Split:
    """The parts with those that were too long in pieces, and what a maker is told of it."""

    made: Made
    notes: tuple[str, ...]


def split_long(made: Made, bed: tuple[float, float, float], rules: Rules) -> Split:
    """Cut every part across that the bed (x, y, z, mm) does not hold, as often as it needs.

    Raises FabricationError, with sizes, for a part that no such cut helps.
    """
    notes: list[str] = []
    index = 0
    while index < len(made.parts):
        name, count = made.parts[index].name, 1
        while not _fits(made.parts[index + count - 1], bed):
            if count == MOST:
                raise _too_large(made.parts[index], bed, "it would take more than six pieces")
            cut = index + count - 1
            made, note = _cut(made, cut, bed, rules)
            notes.append(note)
            count += 1
            # The piece that is cut off fits; the rest comes behind it.
        if count > 1:
            made = _renamed(made, index, count, name)
            notes = [n.replace("{pieces}", _letters(name, count)) for n in notes]
        index += count
    return Split(made, tuple(notes))


def _letters(name: str, count: int) -> str:
    return " and ".join(f"{name}-{chr(97 + k)}" for k in range(count))


def _fits(part: Part, bed: tuple[float, float, float]) -> bool:
    return fits(laid(part.surface, part.down), bed)


def _too_large(part: Part, bed: tuple[float, float, float], why: str) -> FabricationError:
    x, y, z = np.ptp(laid(part.surface, part.down).bounds, axis=0)
    return FabricationError(
        f"{part.name} measures {x:.0f} x {y:.0f} x {z:.0f} mm as it is printed, which the bed"
        f" ({bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm) does not hold, and cutting it across does not"
        f" help: {why}; divide it by one more cord plane, make the body smaller, or state another"
        " [fabrication] bed"
    )


def _cut(made: Made, index: int, bed: tuple[float, float, float], rules: Rules) -> tuple[Made, str]:
    """Cut a piece off a part that the bed holds: the longest that leaves about equal ones."""
    part = made.parts[index]
    normal = _long_way(part)
    heights = part.surface.vertices @ normal
    low, high = float(heights.min()), float(heights.max())
    others = sorted(np.ptp(laid(part.surface, part.down).bounds, axis=0))
    reach = _reach(part, normal, bed)
    if reach < 2 * _SHORTEST:
        raise _too_large(part, bed, f"it is {others[1]:.0f} mm wide and {others[0]:.0f} mm high")
    pieces = int(np.ceil((high - low) / reach))
    ideal = low + (high - low) / pieces
    tried = np.arange(
        max(low + _SHORTEST, high - (pieces - 1) * reach),
        min(low + reach, high - _SHORTEST) + 1e-6,
        _STEP,
    )
    tried = tried if len(tried) else np.array([min(ideal, low + reach)])
    room = _clearance(made, index, tried, normal)
    # Where every place cuts something, as little of it as can be.
    order = np.lexsort((np.abs(tried - ideal), -np.minimum(room, 0.0)))
    for height in tried[order]:
        done = _cut_at(made, index, normal, float(height), rules)
        if done is not None:
            return done
    raise _too_large(part, bed, "there is no room for two dowels in any of its sections")


def _long_way(part: Part) -> Float:
    """The direction (3,) in which the part is longest as it lies."""
    flat = laid(part.surface, part.down)
    turned, _ = _rotation(part.surface.vertices, flat.vertices)
    return np.asarray(turned[int(np.ptp(flat.bounds, axis=0).argmax())])


def _rotation(world: Float, lying: Float) -> tuple[Float, Float]:
    """Rows: the axes of the bed in the frame of the device; and the shift."""
    a, b = world - world.mean(axis=0), lying - lying.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    return u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v, world.mean(axis=0)


def _reach(part: Part, normal: Float, bed: tuple[float, float, float]) -> float:
    """How long a box of the part's width and height may be, mm."""
    flat = laid(part.surface, part.down)
    rows, _ = _rotation(part.surface.vertices, flat.vertices)
    along = int(np.abs(rows @ normal).argmax())
    size = np.ptp(flat.bounds, axis=0)
    for length in np.arange(float(size[along]), _SHORTEST, -0.5):
        box = size.copy()
        box[along] = length
        corners = np.array(
            [[x, y, z] for x in (0, box[0]) for y in (0, box[1]) for z in (0, box[2])]
        )
        if fits(Surface(corners, np.array([[0, 1, 2]])), bed):
            return float(length)
    return 0.0


def _clearance(made: Made, index: int, heights: Float, normal: Float) -> Float:
    """How far (n,) planes at these heights keep from what they must not cut, less what they have
    to, mm."""
    spans = []
    for pin in made.pins:
        contact = made.contacts[pin.contact]
        if index in (contact.lower, contact.upper):
            across = np.sqrt(max(0.0, 1 - float(pin.axis @ normal) ** 2)) * pin.socket / 2
            half = abs(float(pin.axis @ normal)) * pin.depth + across
            spans.append((float(pin.center @ normal), half))
    spans += [
        (float(label.center @ normal), label.height) for label in made.labels if label.part == index
    ]
    box = made.parts[index].surface.bounds + np.array([[-1.0], [1.0]])
    spans += [
        (float(end.mouth @ normal), max(end.pocket, 3.0) + 3.0)
        for channel in made.channels
        for end in channel.ends
        if (end.mouth >= box[0]).all() and (end.mouth <= box[1]).all()
    ]
    spans += [(float(seat.center @ normal), 0.75 * _side(seat)) for seat in made.seats]
    if not spans:
        return np.full(len(heights), np.inf)
    middles, halves = (np.array(v) for v in zip(*spans, strict=True))
    gaps = np.abs(heights[:, None] - middles) - halves - _CLEAR
    return np.asarray(gaps.min(axis=1))


def _side(seat: Seat) -> float:
    """The side of a marker seat, mm, by the tools that cut it."""
    points = [t.polygon for t in seat.tools if isinstance(t, Prism)]
    return float(max((np.ptp(p, axis=0).max() for p in points), default=10.0))


def _cut_at(
    made: Made, index: int, normal: Float, height: float, rules: Rules
) -> tuple[Made, str] | None:
    """The parts with one cut there, or None where two dowels have no room."""
    part, bare = made.parts[index], made.bare[index]
    solid = triangle_kernel.to_manifold(part.surface, part.name)
    halves = solid.split_by_plane((-normal).tolist(), -height)
    bares = bare.split_by_plane((-normal).tolist(), -height)
    if any(len(h.decompose()) != 1 for h in halves):
        return None
    axes = frame(normal)
    middle = xyz_middle = np.asarray(triangle_kernel.centroid(triangle_kernel.to_surface(bare)))
    origin = xyz_middle + (height - float(middle @ normal)) * normal
    plane = Plane.from_normal(origin, normal, axes[:, 0])
    into = np.column_stack([plane.axes.T, -plane.axes.T @ plane.origin])
    sections = [h.transform(into).slice(s) for h, s in zip(bares, (-_BESIDE, _BESIDE), strict=True)]
    section = (sections[0] ^ sections[1]).simplify(0.01)
    contact = Contact(
        len(made.cuts), index, index + 1, plane, section, _skin(bare), _hollows(made, index, rules)
    )
    dowels = place_pins([contact], rules.clearance, rules.inner_wall)
    if len(dowels) < 2:
        return None
    new = [replace(d, contact=len(made.contacts)) for d in dowels]
    parts = [
        _half(part, h, new, upper, normal, height)
        for h, upper in zip(halves, (False, True), strict=True)
    ]
    made = _renumbered(made, index, normal, height, contact, new, parts, bares)
    crossed = [c.name for c in made.channels if _crosses(c.inside, normal, height, part)]
    across = f"; the grooves of {', '.join(crossed)} go on across it" if crossed else ""
    return made, (
        f"{part.name.removesuffix('-rest')} is too long for the bed and is printed in pieces,"
        f" {{pieces}}, cut across near {xyz(origin)}: join them first, with glue"
        f" ({section.area() / 100:.1f} cm2) and two dowels of {new[0].diameter:g} and"
        f" {new[1].diameter:g} mm{across}, so see that no glue or edge stands in them"
    )


def _skin(bare: Any) -> Surface:
    return triangle_kernel.to_surface(bare)


def _hollows(made: Made, index: int, rules: Rules) -> tuple[tuple[Any, float], ...]:
    """Channels and sockets, each as points and a radius."""
    out = [
        (cKDTree(points), radius)
        for channel in made.channels
        for points, radius in channel.hollows(rules.channel, rules.pockets)
    ]
    for pin in made.pins:
        contact = made.contacts[pin.contact]
        if index in (contact.lower, contact.upper):
            along = np.linspace(-pin.depth, pin.depth, 25)[:, None] * pin.axis
            out.append((cKDTree(pin.center + along), pin.socket / 2))
    return tuple(out)


def _half(
    part: Part, half: Any, dowels: Sequence[Pin], upper: bool, normal: Float, height: float
) -> Part:
    """A piece with its sockets, its solid of OpenCascade where the part has one."""
    tools = [d.socket_in(upper=upper) for d in dowels]
    out = -normal if upper else normal
    surface = triangle_kernel.printable(
        triangle_kernel.without(half, tools),
        part.name,
        [(out, -height if upper else height)],
    )
    solid = None
    if part.solid is not None:
        from ..kernels import occ

        square = _HALF * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
        away = Prism(height * normal, frame(out), square, _HALF)
        solid = occ.without(part.solid, [away, *tools])
    return Part(
        part.name if not upper else part.name.removesuffix("-rest") + "-rest",
        surface,
        surface.volume,
        triangle_kernel.centroid(surface),
        part.down,
        solid,
    )


def _crosses(points: Float, normal: Float, height: float, part: Part) -> bool:
    """Whether a cord's path crosses the plane within the part's bounds."""
    above = points @ normal > height
    at = np.flatnonzero(above[1:] != above[:-1])
    low, high = part.surface.bounds
    return any((points[k] > low - 0.5).all() and (points[k] < high + 0.5).all() for k in at)


def _renumbered(
    made: Made,
    index: int,
    normal: Float,
    height: float,
    contact: Contact,
    dowels: Sequence[Pin],
    parts: Sequence[Part],
    bares: Sequence[Any],
) -> Made:
    """All that names parts by their index, with one part more."""

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
    lost = made.parts[index].volume - sum(p.volume for p in parts)
    return replace(
        made,
        parts=(*made.parts[:index], *parts, *made.parts[index + 1 :]),
        bare=(*made.bare[:index], *bares, *made.bare[index + 1 :]),
        cuts=tuple(cuts),
        contacts=(*old, new),
        pins=(*pins, *(replace(d, contact=len(old)) for d in dowels)),
        labels=tuple(labels),
        cut_out=made.cut_out + lost,
    )


def _clipped(contact: Contact, normal: Float, height: float) -> Any:
    """What of a contact's face lies where `normal` looks, beyond the height."""
    import manifold3d as m3

    plane = contact.plane
    way = plane.axes[:, :2].T @ normal
    size = float(np.linalg.norm(way))
    if size < 1e-6:
        return contact.section
    away = (height - float(plane.origin @ normal)) / size
    x = way / size
    y = np.array([-x[1], x[0]])
    corners = [away * x - _HALF * y, (away + _HALF) * x - _HALF * y]
    corners += [(away + _HALF) * x + _HALF * y, away * x + _HALF * y]
    return contact.section ^ m3.CrossSection([np.array(corners)])


def _renamed(made: Made, index: int, count: int, name: str) -> Made:
    """Pieces by letters, in the order in which they follow one another."""
    parts = list(made.parts)
    for k in range(count):
        parts[index + k] = replace(parts[index + k], name=f"{name}-{chr(97 + k)}")
    return replace(made, parts=tuple(parts))
