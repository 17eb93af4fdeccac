"""Plan which pieces of a body each cord plane cuts, and divide the body.

A plane cuts only the pieces that its cords run through.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane, group_coincident_planes
from ...core.errors import FabricationError
from ..channels.cord_channels import Channel
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism
from .channel_openings import ChannelOpening, cut_planes, find_channel_openings
from .piece_opening import PieceOpener, make_thread, runs_in, solids_of

PIN_MARGIN_MM = 6.0  # kept for a pin next to a cord where a cut is limited
OPENING_MM_PER_PART = 15.0  # of channel along another cut's face that weighs as much as one part
LIMITED_CUT_COST = 0.5  # parts that a limited cut must save
ROUGH_TOLERANCE_MM = 0.3  # by which the body may differ while plans are compared
#: Parts below this share of the body are hard to print and to handle.
SMALL_PART_SHARE = 0.01


#: All orders of the cuts are compared for up to this many planes.
MAX_PERMUTED_PLANES = 4


@dataclass(frozen=True)
class Cut:
    """One planar cut.

    Attributes:
        plane: The plane.
        center: Center of mass (3,) of the piece that it divides, mm.
        cords: Indices of the cords that run in it.
        sides: Indices of the final parts below and above it.
        taken: If it does not divide the whole piece, centers of mass (3,) of the solids that come
            off.
        region: Of a limited cut, the prisms around its cords that bound the cut-off solid and,
            smaller by the play, the lid that replaces it.
        wires: Those of the cords of which only wires run in it.
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
    """A divided body.

    Attributes:
        parts: The parts (manifold3d solids).
        leaves: The same without channels.
        cuts: The cuts, in order.
        removed: Volume of the channels, mm^3.
    """

    parts: tuple[Any, ...]
    leaves: tuple[Any, ...]
    cuts: tuple[Cut, ...]
    removed: float


@dataclass(frozen=True)
class PlannedCut:
    """A cut of `piece` whose leaves [a, b) lie below the plane and [b, c) above; the rest as in
    `Cut`.
    """

    plane: Plane
    piece: Any
    cords: tuple[int, ...]
    span: tuple[int, int, int]
    taken: tuple[Any, ...]
    region: tuple[Prism, Prism] | None
    gap: Any


@dataclass(frozen=True)
class Plan:
    """A planned division, without channels.

    Attributes:
        leaves: The pieces from left to right.
        cuts: The cuts between them.
    """

    leaves: list[Any]
    cuts: list[PlannedCut]

    def find_openings(
        self, channels: Sequence[Channel], radius: float, wall: float
    ) -> list[ChannelOpening]:
        """Return where channels and their leads run along the faces of other cords' cuts."""
        faces = [
            cut_planes(c.plane.normal, c.plane.origin, c.region[0] if c.region else None)
            for c in self.cuts
        ]
        lines = [(k, line) for k, c in enumerate(channels) for line in c.insides]
        return find_channel_openings(self.leaves, faces, lines, radius, wall)

    def count_joints(self, cord: int, line: Any) -> int:
        """Return in how many joints a cord lies, given its center line as a thin tube."""
        return sum(cord in c.cords and runs_in(line, c.piece) for c in self.cuts)

    @property
    def burden(self) -> float:
        """Number of pieces; one that is too small to handle well counts up to twice."""
        volumes = np.array([float(p.volume()) for p in self.leaves])
        small = np.clip(1 - volumes / (SMALL_PART_SHARE * volumes.sum()), 0, None)
        return len(volumes) + float(small.sum())

    @property
    def smallest(self) -> float:
        """Volume of the smallest piece, mm^3."""
        return min(float(p.volume()) for p in self.leaves)


def cut_orders(planes: int, early: Sequence[int] = ()) -> list[tuple[int, ...]]:
    """Return the orders of cuts to compare, for parts and for the optimizer's thin parts.

    Args:
        planes: Number of planes.
        early: Indices of planes that should be cut first.

    Returns:
        Orders of plane indices: all of them for few planes, whose parts depend on it; for more
        the given order, and that with the `early` ones first.
    """
    order = tuple(range(planes))
    if planes <= MAX_PERMUTED_PLANES:
        return list(itertools.permutations(order))
    rest = tuple(i for i in order if i not in early)
    return list(dict.fromkeys([order, (*early, *rest)]))


def plan_division(
    body: Any,
    channels: Sequence[Channel],
    radius: float,
    wall: float,
    play: float,
    limit: bool = False,
    through: bool = False,
    across: float = 0.0,
) -> Plan:
    """Plan the cuts that divide a body into few parts that print well.

    A plane cuts only the pieces through which its cords run, and of what it would cut off only what
    a cord touches. Orders of cuts are compared, and cuts right through with limited ones that end a
    little beyond their cords, by the number of parts and by how far channels run along the faces of
    other cuts. Before that, cords shorter than `across` between their ferrules are each placed in
    one joint, if possible: in several, a joint that is closed later pulls at them while it is open.

    Args:
        body: The body (manifold3d solid).
        channels: The channels.
        radius: Radius of the channels, mm.
        wall: Least wall between a channel and another cut's face, mm.
        play: Play of the lid of a limited cut, mm.
        limit: Whether all cuts are limited.
        through: Whether all cuts go right through.
        across: Length below which a cord is placed in one joint, mm.
    """
    coplanar = group_coincident_planes([c.sensor.plane for c in channels])
    planes = [channels[group[0]].sensor.plane for group in coplanar]
    normals = [c.sensor.plane.normal for c in channels]
    threads = [make_thread(c.lines, n) for c, n in zip(channels, normals, strict=True)]
    margin = 2 * radius + 2 * wall + PIN_MARGIN_MM
    rough = body.simplify(ROUGH_TOLERANCE_MM)  # accurate enough to compare plans
    short_threads = {
        k: make_thread([c.line], normals[k]) for k, c in enumerate(channels) if c.between < across
    }
    early = [i for i, group in enumerate(coplanar) if any(k in short_threads for k in group)]
    candidates: list[tuple[int, float, float, float | None, Sequence[int]]] = []
    for cut_margin in (margin,) if limit else (None,) if through else (None, margin):
        opener = PieceOpener(planes, coplanar, threads, cut_margin, play)
        for order in cut_orders(len(planes), early):
            candidate = _cut(rough, planes, order, opener)
            split_cords = sum(
                candidate.count_joints(k, line) > 1 for k, line in short_threads.items()
            )
            cost = candidate.burden + (LIMITED_CUT_COST if cut_margin and not limit else 0.0)
            if candidates and (split_cords, cost) > min(t[:2] for t in candidates):
                continue
            cost += (
                sum(g.length for g in candidate.find_openings(channels, radius, wall))
                / OPENING_MM_PER_PART
            )
            candidates.append((split_cords, cost, -candidate.smallest, cut_margin, order))
    _, _, _, best, chosen = min(candidates, key=lambda t: t[:3])
    opener = PieceOpener(planes, coplanar, threads, best, play)
    return _cut(body, planes, chosen, opener)


def divide_body(body: Any, channels: Sequence[Channel], planned: Plan) -> Division:
    """Cut the channels out of a body and divide it as planned.

    Raises:
        FabricationError: If a channel cuts a part in two.
    """
    hollow = triangle_kernel.union([c.solid for c in channels])
    cords = [make_thread([c.line], c.sensor.plane.normal) for c in channels]
    parts = [_check_whole(leaf - hollow, channels) for leaf in planned.leaves]
    cuts = tuple(
        Cut(
            c.plane,
            triangle_kernel.to_surface(c.piece).centroid,
            c.cords,
            (tuple(range(*c.span[:2])), tuple(range(*c.span[1:]))),
            tuple(triangle_kernel.to_surface(t).centroid for t in c.taken),
            c.region,
            tuple(k for k in c.cords if channels[k].leads and not runs_in(cords[k], c.piece)),
        )
        for c in planned.cuts
    )
    # One by one: a union of channels and gaps, whose walls coincide, may lose some.
    gaps = [c.gap - hollow for c in planned.cuts if c.gap is not None]
    removed = sum(float(v.volume()) for v in (body ^ hollow, *gaps))
    return Division(tuple(parts), tuple(planned.leaves), cuts, removed)


def _check_whole(leaf: Any, channels: Sequence[Channel]) -> Any:
    """Return a leaf after its channels were cut out; raise FabricationError if they cut it in
    two.
    """
    pieces = sorted(solids_of(leaf), key=lambda p: -float(p.volume()))
    if len(pieces) > 1:
        chip = pieces[1]
        center = triangle_kernel.to_surface(chip).centroid
        at = format_point(center)
        cords = [repr(c.name) for c in channels if c.solid.min_gap(chip, 0.1) < 0.05]
        raise FabricationError(
            f"cuts a piece of {chip.volume():.1f} mm3 off its part near {at}",
            code="channel-cuts-part",
            where=f"the channel of cord {' and '.join(cords)}",
            action="Move it away from the planes of other cords",
            cords=[c.name for c in channels if repr(c.name) in cords],
            at=center.tolist(),
        )
    if not pieces:
        raise FabricationError(
            "a channel fills a whole part",
            code="channel-fills-part",
            action="Move the planes of the cords apart",
        )
    return pieces[0]


def _cut(body: Any, planes: Sequence[Plane], order: Sequence[int], opener: PieceOpener) -> Plan:
    """Cut depth first, so that the parts of a piece stay neighbors in the list."""
    out = Plan([], [])

    def descend(piece: Any, todo: Sequence[int]) -> None:
        for n, i in enumerate(todo):
            opened = opener.open(piece, i)
            halves = opened.halves
            if halves is None:
                continue
            at, a = len(out.cuts), len(out.leaves)
            out.cuts.append(PlannedCut(planes[i], piece, opened.cords, (a, a, a), (), None, None))
            for solid in halves.below:
                descend(solid, todo[n + 1 :])
            b = len(out.leaves)
            for solid in halves.above:
                descend(solid, todo[n + 1 :])
            out.cuts[at] = replace(
                out.cuts[at],
                span=(a, b, len(out.leaves)),
                taken=halves.taken,
                region=halves.by,
                gap=halves.gap,
            )
            return
        out.leaves.append(piece)

    descend(body, order)
    return out
