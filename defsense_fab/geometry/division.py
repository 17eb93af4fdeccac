"""Which pieces of a body each cord plane has to cut: only those that its cords run through."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import manifold3d as m3
import numpy as np

from ..core.arrays import Float
from ..core.curve import Plane, coincident
from ..core.errors import FabricationError
from . import facets
from .channels import Channel
from .grazing import Graze, borders, grazes
from .tools import Prism

#: All orders of the cuts are tried for up to this many planes.
_ALL_ORDERS = 4
_THREAD = 0.05  # mm, diameter of the line that stands for a cord
_BLOCKED = 0.01  # mm^3, of overlap that stops a part on its way out
_PIN = 6.0  # mm, kept for a pin beside a cord where a cut is limited
_WORTH = 15.0  # mm of channel along another cut's face weigh as much as one part
_LIMITED = 0.5  # parts that a limited cut has to save
_ROUGH = 0.3  # mm, by which the body may differ where plans are compared
_DUST = 0.05  # mm^3; less than a printer can lay down is left out


@dataclass(frozen=True)
class Cut:
    """One planar cut: the centre of mass (3,) mm of the piece that it divides, the cords that
    run in it there, and the final parts below and above it (by index).

    Where the plane does not divide the whole piece, `taken` are the centres of mass of the solids
    that come off it and `region` what bounds them: the plane and, for a limited cut, the prism
    around its cords.
    """

    plane: Plane
    center: Float
    cords: tuple[int, ...]
    sides: tuple[tuple[int, ...], tuple[int, ...]]
    taken: tuple[Float, ...] = ()
    region: Prism | None = None


@dataclass(frozen=True)
class Division:
    """The parts (manifold3d solids), the same without channels, the cuts in order, the volume of
    the channels, mm^3, and where channels open into the faces of others' cuts."""

    parts: tuple[Any, ...]
    leaves: tuple[Any, ...]
    cuts: tuple[Cut, ...]
    removed: float
    grazes: tuple[Graze, ...]


@dataclass(frozen=True)
class Planned:
    """A cut of `piece` whose leaves [a, b) lie below the plane and [b, c) above."""

    plane: Plane
    piece: Any
    cords: tuple[int, ...]
    span: tuple[int, int, int]
    taken: tuple[Any, ...]
    region: Prism | None


@dataclass(frozen=True)
class Plan:
    """Pieces from left to right, and the cuts between them. No channels yet."""

    leaves: list[Any]
    cuts: list[Planned]

    def grazes(self, lines: Sequence[Float], radius: float, wall: float) -> list[Graze]:
        """Where channels run along the faces of others' cuts."""
        faces = [borders(c.plane.normal, c.plane.origin, c.region) for c in self.cuts]
        return grazes(self.leaves, faces, lines, radius, wall)

    @property
    def smallest(self) -> float:
        """Volume of the smallest piece, mm^3."""
        return min(float(p.volume()) for p in self.leaves)


def plan(
    body: Any, channels: Sequence[Channel], radius: float, wall: float, limit: bool = False
) -> Plan:
    """The cuts that divide the body into few parts that print well.

    A plane cuts only those pieces through which its cords run, and of what it would cut off only
    what a cord touches. Orders of cuts are compared, and cuts that go through with those that end
    a little beyond their cords (only these with `limit`), by how many parts result and how far
    channels (of `radius` mm) run along the faces of others' cuts, with less than `wall` mm between.
    """
    own = coincident([c.sensor.plane for c in channels])
    planes = [channels[same[0]].sensor.plane for same in own]
    threads = [facets.tube(c.line, c.sensor.plane.normal, _THREAD, sides=8) for c in channels]
    count = len(planes)
    orders = list(itertools.permutations(range(count))) if count <= _ALL_ORDERS else [range(count)]
    margin = 2 * radius + 2 * wall + _PIN
    rough = body.simplify(_ROUGH)  # good enough to compare plans on
    lines = [c.inside for c in channels]
    tried: list[tuple[float, float, float | None, Sequence[int]]] = []
    for m in (margin,) if limit else (None, margin):
        for order in orders:
            made = _cut(rough, planes, threads, own, order, m)
            cost = len(made.leaves) + (_LIMITED if m and not limit else 0.0)
            if tried and cost > min(t[0] for t in tried):
                continue
            cost += sum(g.length for g in made.grazes(lines, radius, wall)) / _WORTH
            tried.append((cost, -made.smallest, m, order))
    _, _, best, chosen = min(tried, key=lambda t: t[:2])
    return _cut(body, planes, threads, own, chosen, best)


def divide(
    body: Any, channels: Sequence[Channel], radius: float, wall: float, limit: bool = False
) -> Division:
    """Cut the channels out of the body and divide it as `plan` says.

    Raises FabricationError where a channel cuts a part in two.
    """
    planned = plan(body, channels, radius, wall, limit)
    hollow = facets.union([c.solid for c in channels])
    parts = [_whole(leaf - hollow, channels) for leaf in planned.leaves]
    cuts = tuple(
        Cut(
            c.plane,
            facets.centroid(facets.to_surface(c.piece - hollow)),
            c.cords,
            (tuple(range(*c.span[:2])), tuple(range(*c.span[1:]))),
            tuple(facets.centroid(facets.to_surface(t - hollow)) for t in c.taken),
            c.region,
        )
        for c in planned.cuts
    )
    removed = float((body ^ hollow).volume())
    found = planned.grazes([c.inside for c in channels], radius, wall)
    return Division(tuple(parts), tuple(planned.leaves), cuts, removed, tuple(found))


def _whole(leaf: Any, channels: Sequence[Channel]) -> Any:
    """A leaf that was rid of its channels; refused where they cut it in two."""
    pieces = sorted(leaf.decompose(), key=lambda p: -float(p.volume()))
    if len(pieces) > 1 and pieces[1].volume() > _DUST:
        chip = pieces[1]
        at = ", ".join(f"{x:.1f}" for x in facets.centroid(facets.to_surface(chip)))
        near = [repr(c.name) for c in channels if c.solid.min_gap(chip, 0.1) < 0.05]
        raise FabricationError(
            f"the channel of cord {' and '.join(near)} cuts a piece of {chip.volume():.1f} mm^3 off"
            f" its part near ({at}); move it away from the other cords' planes"
        )
    if not pieces:
        raise FabricationError("a channel takes up a whole part; move the cords' planes apart")
    return pieces[0]


def _cut(
    body: Any,
    planes: Sequence[Plane],
    threads: Sequence[Any],
    own: Sequence[Sequence[int]],
    order: Sequence[int],
    margin: float | None,
) -> Plan:
    """Cut depth first, so that the parts of a piece stay neighbours in the list."""
    out = Plan([], [])

    def descend(piece: Any, todo: Sequence[int]) -> None:
        for n, i in enumerate(todo):
            inside = tuple(c for c in own[i] if _runs_in(threads[c], piece))
            if not inside:
                continue
            line = facets.union([threads[c] for c in inside])
            halves = min(
                _options(piece, planes[i], line, margin),
                key=lambda h: (len(h.below) + len(h.above), h.rank),
                default=None,
            )
            if halves is None:
                continue
            at, a = len(out.cuts), len(out.leaves)
            out.cuts.append(Planned(planes[i], piece, inside, (a, a, a), halves.taken, halves.by))
            for solid in halves.below:
                descend(solid, todo[n + 1 :])
            b = len(out.leaves)
            for solid in halves.above:
                descend(solid, todo[n + 1 :])
            span = (a, b, len(out.leaves))
            out.cuts[at] = Planned(planes[i], piece, inside, span, halves.taken, halves.by)
            return
        out.leaves.append(piece)

    descend(body, order)
    return out


def _runs_in(thread: Any, piece: Any) -> bool:
    return float((piece ^ thread).volume()) > 0.1 * _THREAD**2


@dataclass(frozen=True)
class _Halves:
    """A way to open a piece along a plane; of two alike the one with the lower `rank` is taken."""

    below: list[Any]
    above: list[Any]
    rank: float
    taken: tuple[Any, ...] = ()
    by: Prism | None = None


def _options(piece: Any, plane: Plane, line: Any, margin: float | None) -> Iterator[_Halves]:
    """Ways to open the piece along the plane for the cords of `line`: through and through, or only
    what they touch on one side, where that comes out."""
    above, below = piece.split_by_plane(plane.normal, float(plane.normal @ plane.origin))
    if above.is_empty() or below.is_empty():
        return
    sides = (below.decompose(), above.decompose())
    if margin is None:
        yield _Halves(*sides, rank=0.0)
        if len(sides[0]) + len(sides[1]) == 2:
            return
    prism = None if margin is None else _around(piece, plane, line, margin)
    found = False
    for s, (side, out) in enumerate(((below, -plane.normal), (above, plane.normal))):
        whole = side if prism is None else side ^ facets.solid_of(prism[s])
        taken = [c for c in whole.decompose() if _runs_in(line, c)]
        rest = piece - facets.union(taken) if taken else None
        if rest is None or rest.is_empty() or not _comes_out(facets.union(taken), rest, out):
            continue
        found = True
        lower, upper = (taken, rest.decompose()) if s == 0 else (rest.decompose(), taken)
        share = sum(float(t.volume()) for t in taken) / float(piece.volume())
        yield _Halves(lower, upper, 1.0 + share, tuple(taken), prism[s] if prism else None)
    if margin is not None and not found:
        yield _Halves(*sides, rank=0.0)


def _around(piece: Any, plane: Plane, line: Any, margin: float) -> tuple[Prism, Prism]:
    """The prisms below and above the plane that reach `margin` mm beyond the cords in it."""
    corners = facets.to_surface(piece ^ line).vertices
    flat = (corners - plane.origin) @ plane.axes[:, :2]
    grown = m3.CrossSection.hull_points(flat).offset(margin, m3.JoinType.Miter, 2.0)
    polygon = np.asarray(grown.simplify(0.05).to_polygons()[0], float)
    box = facets.to_surface(piece).vertices @ plane.normal - plane.normal @ plane.origin
    low, high = 1.0 - float(box.min()), 1.0 + float(box.max())
    down = Prism(plane.origin - low * plane.normal, plane.axes, polygon, low)
    return down, Prism(plane.origin, plane.axes, polygon, high)


def _comes_out(taken: Any, rest: Any, direction: Float) -> bool:
    """Whether nothing of the rest lies in the way of what is taken off along the direction."""
    low, high = np.reshape(rest.bounding_box(), (2, 3))
    far = float(np.linalg.norm(high - low))
    return all(
        float((rest ^ taken.translate(direction * far * t)).volume()) < _BLOCKED
        for t in (0.01, 0.03, 0.06, 0.1, 0.2, 0.4, 0.7, 1.0)
    )
