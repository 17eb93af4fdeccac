"""Which pieces of a body each cord plane has to cut: only those that its cords run through."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Float
from ..core.curve import Plane, coincident
from ..core.device import Sensor
from . import facets

#: All orders of the cuts are tried for up to this many planes.
_ALL_ORDERS = 4
_THREAD = 0.05  # mm, diameter of the line that stands for a cord


@dataclass(frozen=True)
class Cut:
    """One planar cut: the centre of mass (3,) mm of the piece that it divides, the cords that
    run in it there, and the final parts below and above it (by index)."""

    plane: Plane
    center: Float
    cords: tuple[int, ...]
    sides: tuple[tuple[int, ...], tuple[int, ...]]


@dataclass(frozen=True)
class Division:
    """The parts (manifold3d solids), the cuts in order, and the volume of the channels, mm^3."""

    parts: tuple[Any, ...]
    cuts: tuple[Cut, ...]
    removed: float


@dataclass(frozen=True)
class Plan:
    """Pieces from left to right; cuts as (plane, piece, cords, (a, b, c)): the leaves [a, b) lie
    below it and [b, c) above. No channels yet."""

    leaves: list[Any]
    cuts: list[tuple[Plane, Any, tuple[int, ...], tuple[int, int, int]]]

    @property
    def smallest(self) -> float:
        """Volume of the smallest piece, mm^3."""
        return min(float(p.volume()) for p in self.leaves)


def channel_line(sensor: Sensor, ends: tuple[float, float]) -> Float:
    """The channel's centre line (p, 3) mm with its straight runs out of the body."""
    points = sensor.plane.to_world(sensor.curve.sample(24))
    tangents = sensor.curve.tangents @ sensor.plane.axes[:, :2].T
    first, last = (t / np.linalg.norm(t) for t in (tangents[0], tangents[-1]))
    return np.concatenate([points[:1] - ends[0] * first, points, points[-1:] + ends[1] * last])


def plan(body: Any, cords: Sequence[tuple[Plane, Float]]) -> Plan:
    """The cuts that divide the body into as few parts as it takes.

    `cords` are each one's plane and centre line (p, 3) mm, which should reach out of the body. A
    plane cuts only those pieces through which its cords run. Of the orders of cuts that give
    equally few parts the one with the largest smallest part wins.
    """
    own = coincident([p for p, _ in cords])
    planes = [cords[same[0]][0] for same in own]
    threads = [facets.tube(line, plane.normal, _THREAD, sides=8) for plane, line in cords]
    count = len(planes)
    orders = itertools.permutations(range(count)) if count <= _ALL_ORDERS else [range(count)]
    plans = (_cut(body, planes, threads, own, order) for order in orders)
    return min(plans, key=lambda p: (len(p.leaves), -p.smallest))


def divide(body: Any, cords: Sequence[tuple[Plane, Float]], diameter: float) -> Division:
    """Cut channels of `diameter` mm out of the body and divide it as `plan` says."""
    planned = plan(body, cords)
    channels = facets.union([facets.tube(line, plane.normal, diameter) for plane, line in cords])
    parts = [(leaf - channels).decompose() for leaf in planned.leaves]
    first = np.cumsum([0, *(len(p) for p in parts)]).tolist()
    cuts = tuple(
        Cut(
            plane,
            facets.centroid(facets.to_surface(piece - channels)),
            inside,
            (tuple(range(first[a], first[b])), tuple(range(first[b], first[c]))),
        )
        for plane, piece, inside, (a, b, c) in planned.cuts
    )
    removed = float((body ^ channels).volume())
    return Division(tuple(p for pieces in parts for p in pieces), cuts, removed)


def _cut(
    body: Any,
    planes: Sequence[Plane],
    threads: Sequence[Any],
    own: Sequence[Sequence[int]],
    order: Sequence[int],
) -> Plan:
    """Cut depth first, so that the parts of a piece stay neighbours in the list."""
    out = Plan([], [])

    def descend(piece: Any, todo: Sequence[int]) -> None:
        for n, i in enumerate(todo):
            inside = tuple(c for c in own[i] if (piece ^ threads[c]).volume() > 0.1 * _THREAD**2)
            if not inside:
                continue
            plane = planes[i]
            above, below = piece.split_by_plane(plane.normal, float(plane.normal @ plane.origin))
            if above.is_empty() or below.is_empty():
                continue
            at, a = len(out.cuts), len(out.leaves)
            out.cuts.append((plane, piece, inside, (a, a, a)))
            for solid in below.decompose():
                descend(solid, todo[n + 1 :])
            b = len(out.leaves)
            for solid in above.decompose():
                descend(solid, todo[n + 1 :])
            out.cuts[at] = (plane, piece, inside, (a, b, len(out.leaves)))
            return
        out.leaves.append(piece)

    descend(body, order)
    return out
