"""Which pieces of a body each cord plane has to cut: only those that its cords run through."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane, group_coincident_planes
from ...core.errors import FabricationError
from ..channels.cord_channels import Channel
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import CRUMB, Prism
from .channel_openings import ChannelOpening, borders, channel_openings
from .cut_orders import cut_orders

_THREAD = 0.05  # mm, diameter of the line that stands for a cord
_BLOCKED = 0.1  # mm^2, by which parts may cover each other and still come apart
_PIN = 6.0  # mm, kept for a pin beside a cord where a cut is limited
_WORTH = 15.0  # mm of channel along another cut's face weigh as much as one part
_LIMITED = 0.5  # parts that a limited cut has to save
_ROUGH = 0.3  # mm, by which the body may differ where plans are compared
#: Parts smaller than this part of the body are hard to print and to handle.
SMALL = 0.01


@dataclass(frozen=True)
class Cut:
    """One planar cut: the centre of mass (3,) mm of the piece that it divides, the cords that
    run in it there (`wires`: those of which only wires do), and the final parts below and above it
    (by index).

    Where the plane does not divide the whole piece, `taken` are the centres of mass of the solids
    that come off it. Of a limited cut, `region` are the prisms around its cords that bound what is
    cut off and, a play smaller, the lid that goes in its place.
    """

    plane: Plane
    center: Float
    cords: tuple[int, ...]
    sides: tuple[tuple[int, ...], tuple[int, ...]]
    taken: tuple[Float, ...] = ()
    region: tuple[Prism, Prism] | None = None
    wires: tuple[int, ...] = ()


@dataclass(frozen=True)
class Division:
    """The parts (manifold3d solids), the same without channels, the cuts in order, and the volume
    of the channels, mm^3."""

    parts: tuple[Any, ...]
    leaves: tuple[Any, ...]
    cuts: tuple[Cut, ...]
    removed: float


@dataclass(frozen=True)
class Planned:
    """A cut of `piece` whose leaves [a, b) lie below the plane and [b, c) above."""

    plane: Plane
    piece: Any
    cords: tuple[int, ...]
    span: tuple[int, int, int]
    taken: tuple[Any, ...]
    region: tuple[Prism, Prism] | None
    gap: Any


@dataclass(frozen=True)
class Plan:
    """Pieces from left to right, and the cuts between them. No channels yet."""

    leaves: list[Any]
    cuts: list[Planned]

    def grazes(
        self, channels: Sequence[Channel], radius: float, wall: float
    ) -> list[ChannelOpening]:
        """Where channels and their leads run along the faces of others' cuts."""
        faces = [
            borders(c.plane.normal, c.plane.origin, c.region[0] if c.region else None)
            for c in self.cuts
        ]
        lines = [(k, line) for k, c in enumerate(channels) for line in c.insides]
        return channel_openings(self.leaves, faces, lines, radius, wall)

    def joints_of(self, cord: int, line: Any) -> int:
        """In how many joints a cord is laid, whose middle `line` is this thin tube."""
        return sum(cord in c.cords and _runs_in(line, c.piece) for c in self.cuts)

    @property
    def burden(self) -> float:
        """The number of pieces; one that is too small to handle well counts up to twice."""
        volumes = np.array([float(p.volume()) for p in self.leaves])
        small = np.clip(1 - volumes / (SMALL * volumes.sum()), 0, None)
        return len(volumes) + float(small.sum())

    @property
    def smallest(self) -> float:
        """Volume of the smallest piece, mm^3."""
        return min(float(p.volume()) for p in self.leaves)


def plan(
    body: Any,
    channels: Sequence[Channel],
    radius: float,
    wall: float,
    play: float,
    limit: bool = False,
    through: bool = False,
    across: float = 0.0,
) -> Plan:
    """The cuts that divide the body into few parts that print well.

    A plane cuts only those pieces through which its cords run, and of what it would cut off only
    what a cord touches. Orders of cuts are compared, and cuts that go through with those that end
    a little beyond their cords (only these with `limit`, none with `through`), by how many parts
    result and how far channels (of `radius` mm) run along the faces of others' cuts, with less than
    `wall` mm between. Before that, cords shorter than `across` mm between their ferrules are each
    laid in one joint, if that can be: in several, a joint that is closed later pulls at them while
    it is open.
    The lid of a limited cut is `play` mm smaller than what was cut off.
    """
    own = group_coincident_planes([c.sensor.plane for c in channels])
    planes = [channels[same[0]].sensor.plane for same in own]
    threads = [_thread(c.lines, c) for c in channels]
    margin = 2 * radius + 2 * wall + _PIN
    rough = body.simplify(_ROUGH)  # good enough to compare plans on
    short = {k: _thread([c.line], c) for k, c in enumerate(channels) if c.between < across}
    early = [i for i, same in enumerate(own) if any(k in short for k in same)]
    tried: list[tuple[int, float, float, float | None, Sequence[int]]] = []
    for m in (margin,) if limit else (None,) if through else (None, margin):
        known: dict[tuple[int, int], _Opened] = {}
        for order in cut_orders(len(planes), early):
            made = _cut(rough, planes, threads, own, order, m, play, known)
            torn = sum(made.joints_of(k, line) > 1 for k, line in short.items())
            cost = made.burden + (_LIMITED if m and not limit else 0.0)
            if tried and (torn, cost) > min(t[:2] for t in tried):
                continue
            cost += sum(g.length for g in made.grazes(channels, radius, wall)) / _WORTH
            tried.append((torn, cost, -made.smallest, m, order))
    _, _, _, best, chosen = min(tried, key=lambda t: t[:3])
    return _cut(body, planes, threads, own, chosen, best, play, {})


def divide(body: Any, channels: Sequence[Channel], planned: Plan) -> Division:
    """Cut the channels out of the body and divide it as planned.

    Raises FabricationError where a channel cuts a part in two.
    """
    hollow = triangle_kernel.union([c.solid for c in channels])
    cords = [_thread([c.line], c) for c in channels]
    parts = [_whole(leaf - hollow, channels) for leaf in planned.leaves]
    cuts = tuple(
        Cut(
            c.plane,
            triangle_kernel.centroid(triangle_kernel.to_surface(c.piece)),
            c.cords,
            (tuple(range(*c.span[:2])), tuple(range(*c.span[1:]))),
            tuple(triangle_kernel.centroid(triangle_kernel.to_surface(t)) for t in c.taken),
            c.region,
            tuple(k for k in c.cords if channels[k].leads and not _runs_in(cords[k], c.piece)),
        )
        for c in planned.cuts
    )
    # One by one: a union of channels and gaps, whose walls are alike, may lose some.
    gaps = [c.gap - hollow for c in planned.cuts if c.gap is not None]
    removed = sum(float(v.volume()) for v in (body ^ hollow, *gaps))
    return Division(tuple(parts), tuple(planned.leaves), cuts, removed)


def _thread(lines: Sequence[Float], channel: Channel) -> Any:
    """Thin tubes along lines in a channel's plane."""
    normal = channel.sensor.plane.normal
    return triangle_kernel.union([triangle_kernel.tube(x, normal, _THREAD, sides=4) for x in lines])


def _whole(leaf: Any, channels: Sequence[Channel]) -> Any:
    """A leaf that was rid of its channels; refused where they cut it in two."""
    pieces = sorted(_solids(leaf), key=lambda p: -float(p.volume()))
    if len(pieces) > 1:
        chip = pieces[1]
        at = format_point(triangle_kernel.centroid(triangle_kernel.to_surface(chip)))
        near = [repr(c.name) for c in channels if c.solid.min_gap(chip, 0.1) < 0.05]
        raise FabricationError(
            f"the channel of cord {' and '.join(near)} cuts a piece of {chip.volume():.1f} mm^3 off"
            f" its part near {at}; move it away from the other cords' planes",
            code="channel-cuts-part",
            cords=[c.name for c in channels if repr(c.name) in near],
        )
    if not pieces:
        raise FabricationError(
            "a channel takes up a whole part; move the cords' planes apart",
            code="channel-fills-part",
        )
    return pieces[0]


def _cut(
    body: Any,
    planes: Sequence[Plane],
    threads: Sequence[Any],
    own: Sequence[Sequence[int]],
    order: Sequence[int],
    margin: float | None,
    play: float,
    known: dict[tuple[int, int], _Opened],
) -> Plan:
    """Cut depth first, so that the parts of a piece stay neighbours in the list. What is `known` of
    a piece (by its identity) and a plane is used again: orders of cuts have pieces in common."""
    out = Plan([], [])

    def opened(piece: Any, i: int) -> _Opened:
        if (id(piece), i) not in known:
            inside = tuple(c for c in own[i] if _runs_in(threads[c], piece))
            halves = None
            if inside:
                line = triangle_kernel.union([threads[c] for c in inside])
                halves = min(
                    _options(piece, planes[i], line, margin, play),
                    key=lambda h: (len(h.below) + len(h.above), h.rank),
                    default=None,
                )
            known[id(piece), i] = _Opened(piece, inside, halves)
        return known[id(piece), i]

    def descend(piece: Any, todo: Sequence[int]) -> None:
        for n, i in enumerate(todo):
            found = opened(piece, i)
            inside, halves = found.cords, found.halves
            if halves is None:
                continue
            at, a = len(out.cuts), len(out.leaves)
            out.cuts.append(Planned(planes[i], piece, inside, (a, a, a), (), None, None))
            for solid in halves.below:
                descend(solid, todo[n + 1 :])
            b = len(out.leaves)
            for solid in halves.above:
                descend(solid, todo[n + 1 :])
            span = (a, b, len(out.leaves))
            out.cuts[at] = Planned(
                planes[i], piece, inside, span, halves.taken, halves.by, halves.gap
            )
            return
        out.leaves.append(piece)

    descend(body, order)
    return out


def _solids(solid: Any) -> list[Any]:
    """The separate solids of one, without crumbs."""
    return [p for p in solid.decompose() if p.volume() > CRUMB]


def _runs_in(thread: Any, piece: Any) -> bool:
    return float((piece ^ thread).volume()) > 0.1 * _THREAD**2


@dataclass(frozen=True)
class _Halves:
    """A way to open a piece along a plane; of two alike the one with the lower `rank` is taken."""

    below: list[Any]
    above: list[Any]
    rank: float
    taken: tuple[Any, ...] = ()
    by: tuple[Prism, Prism] | None = None
    gap: Any = None


@dataclass(frozen=True)
class _Opened:
    """A piece (kept, so that its identity stays its own), the cords of a plane that run in it, and
    how it is opened for them, if it is."""

    piece: Any
    cords: tuple[int, ...]
    halves: _Halves | None


def _options(
    piece: Any, plane: Plane, line: Any, margin: float | None, play: float
) -> Iterator[_Halves]:
    """Ways to open the piece along the plane for the cords of `line`: through and through, or only
    what they touch on one side, where that comes out."""
    above, below = piece.split_by_plane(plane.normal, float(plane.normal @ plane.origin))
    if above.is_empty() or below.is_empty():
        return
    sides = (_solids(below), _solids(above))
    if not all(sides):
        return
    if margin is None:
        yield _Halves(*sides, rank=0.0)
        if len(sides[0]) + len(sides[1]) == 2:
            return
    prisms = None if margin is None else _around(piece, plane, line, margin, play)
    found = False
    for s, side in enumerate((below, above)):
        column = _solids(side if prisms is None else side ^ triangle_kernel.solid_of(prisms[s][0]))
        touched = [c for c in column if _runs_in(line, c)]
        others = [c for c in column if not _runs_in(line, c)]
        if not touched or _blocked(touched, others, plane):
            continue
        loose = triangle_kernel.union(touched)
        rest = _solids(piece - loose)
        lid = loose if prisms is None else loose ^ triangle_kernel.solid_of(prisms[s][1])
        taken = _solids(lid)
        if not rest or not taken:
            continue
        found = True
        share = float(lid.volume() / piece.volume())
        yield _Halves(
            *((taken, rest) if s == 0 else (rest, taken)),
            rank=1.0 + share,
            taken=tuple(taken),
            by=prisms[s] if prisms else None,
            gap=loose - lid if prisms else None,
        )
    if margin is not None and not found:
        yield _Halves(*sides, rank=0.0)


def _around(
    piece: Any, plane: Plane, line: Any, margin: float, play: float
) -> list[tuple[Prism, Prism]]:
    """The prisms below and above the plane that reach `margin` mm beyond the cords in it, each
    with the one `play` mm smaller across."""
    corners = triangle_kernel.to_surface(piece ^ line).vertices
    flat = (corners - plane.origin) @ plane.axes[:, :2]
    grown = m3.CrossSection.hull_points(flat).offset(margin, m3.JoinType.Miter, 2.0).simplify(0.05)
    polygons = [
        np.asarray(c.to_polygons()[0], float)
        for c in (grown, grown.offset(-play / 2, m3.JoinType.Miter, 2.0))
    ]
    box = triangle_kernel.to_surface(piece).vertices @ plane.normal - plane.normal @ plane.origin
    low, high = 1.0 - float(box.min()), 1.0 + float(box.max())
    bottom = plane.origin - low * plane.normal
    below, above = (
        [Prism(origin, plane.axes, p, height) for p in polygons]
        for origin, height in ((bottom, low), (plane.origin, high))
    )
    return [(below[0], below[1]), (above[0], above[1])]


def _blocked(taken: Sequence[Any], others: Sequence[Any], plane: Plane) -> bool:
    """Whether what stays on the same side of the plane lies in the way of what comes off along
    its normal: whether they cover each other, seen along it."""
    if not others:
        return False
    turn = np.column_stack([plane.axes.T, np.zeros(3)])
    a, b = (triangle_kernel.union(list(s)).transform(turn).project() for s in (taken, others))
    return float((a ^ b).area()) > _BLOCKED
