"""Parts too small or too thin to print, which cord planes leave where they nearly meet."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float
from ..core.curve import distinct
from ..core.device import Sensor
from .freedom import CordFreedom, sample_path
from .inside import evenly
from .problem import Problem

#: Points that stand for the body's volume, and for its surface, where the thinnest wedges end.
_VOLUME, _SURFACE = 3000, 1500
#: All orders of the cuts are tried for up to this many planes, as in `geometry/division.py`.
_ALL_ORDERS = 4
_MARGIN = 1.2  # what the points may miss


@dataclass(frozen=True)
class Leaf:
    """A part as the points (p,) that lie in it and the distinct planes that bound it."""

    inside: Bool
    planes: tuple[int, ...]


class Slivers:
    """Looks for slivers by points: the cuts of `geometry/division.py` without solids."""

    def __init__(self, problem: Problem) -> None:
        rng = np.random.default_rng(0)
        volume, surface = evenly(problem, _VOLUME, rng), problem.surface
        corners = surface.vertices[surface.faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(cross, axis=1)
        face = rng.choice(len(area), _SURFACE, p=area / area.sum())
        skin = np.einsum("ci,cij->cj", rng.dirichlet(np.ones(3), _SURFACE), corners[face])
        self._points = np.concatenate([volume, surface.vertices[:_SURFACE], skin])
        depth = problem.depth(volume)[0]
        self._depth = np.concatenate([depth, np.zeros(len(self._points) - len(depth))])
        self._limits = problem.limits

    def __call__(self, sensors: Sequence[Sensor]) -> bool:
        """Whether the layout leaves slivers."""
        return self._first(sensors) is not None

    def guard(
        self, cords: Sequence[CordFreedom], old: Float, new: Float
    ) -> tuple[Float, Float] | None:
        """An inequality at parameters `new` (size,) that rules out the sliver there: value (1,) mm
        and row (1, size); None without one. Thin parts that were thick at `old` are to be thick,
        others not to be."""
        ends = np.cumsum([0, *(c.size for c in cords)])
        parts = [slice(a, b) for a, b in itertools.pairwise(ends)]
        found = self._first([c.apply(new[p]) for c, p in zip(cords, parts, strict=True)])
        if found is None:
            return None
        was, value, row = 0.0, 0.0, np.zeros(len(new))
        point, owners = found
        for owner in owners:
            cord, part = cords[owner], parts[owner]
            now, by = cord.height(new[part], point)
            side = 1.0 if now >= 0 else -1.0
            value += side * now
            was += side * cord.height(old[part], point)[0]
            row[part] += side * by
        if was > value:
            return np.array([value - 1.5 * max(value, self._limits.wall)]), row[None]
        return np.array([-value - 1e-2]), -row[None]

    def _first(self, sensors: Sequence[Sensor]) -> tuple[Float, tuple[int, ...]] | None:
        """The point deepest inside the thinnest sliver of the best order of cuts, and the cords
        whose planes are the nearest two there."""
        planes = distinct([s.plane for s in sensors])
        heights = np.stack([(self._points - p.origin) @ p.normal for p in planes])
        own = [
            [i for i, s in enumerate(sensors) if len(distinct([p, s.plane])) == 1] for p in planes
        ]
        paths = [sample_path(s)[::6] for s in sensors]
        runs = [np.stack([(path - p.origin) @ p.normal for p in planes]) for path in paths]
        count = len(planes)
        orders = itertools.permutations(range(count)) if count <= _ALL_ORDERS else [range(count)]
        best: tuple[int, float] | None = None
        parts: list[Leaf] = []
        for order in orders:
            everywhere = np.ones(len(self._points), bool)
            along = [np.ones(r.shape[1], bool) for r in runs]
            leaves = list(self._cut(everywhere, along, list(order), (), heights, runs, own))
            smallest = min(leaf.inside[:_VOLUME].mean() for leaf in leaves)
            if best is None or (len(leaves), -smallest) < best:
                best = (len(leaves), -smallest)
                parts = leaves
        thin = [
            (t, leaf)
            for t, leaf in ((self._thickness(leaf, heights), leaf) for leaf in parts)
            if t < _MARGIN * self._limits.wall
            or leaf.inside[:_VOLUME].mean() < _MARGIN * self._limits.smallest_part
        ]
        if not thin:
            return None
        leaf = min(thin, key=lambda x: x[0])[1]
        inner = np.flatnonzero(leaf.inside)
        near = np.abs(heights[list(leaf.planes)][:, inner])
        k = int(np.minimum(self._depth[inner], near.min(axis=0)).argmax())
        two = np.argsort(near[:, k])[:2]
        return self._points[inner[k]], tuple(own[leaf.planes[i]][0] for i in two.tolist())

    def _thickness(self, leaf: Leaf, heights: Float) -> float:
        """Mean thickness, mm: four times the mean distance from the faces, as in a slab."""
        inner = leaf.inside.copy()
        inner[_VOLUME:] = False
        if not inner.any():
            return 0.0
        near = self._depth[inner]
        for i in leaf.planes:
            near = np.minimum(near, np.abs(heights[i, inner]))
        return float(4 * near.mean())

    def _cut(
        self,
        piece: Bool,
        along: list[Bool],
        todo: list[int],
        planes: tuple[int, ...],
        heights: Float,
        runs: list[Float],
        own: list[list[int]],
    ) -> Iterator[Leaf]:
        for n, i in enumerate(todo):
            if not any(along[c].any() for c in own[i]):
                continue
            above = heights[i] > 0
            low, high = piece & ~above, piece & above
            if not (low.any() and high.any()):
                continue
            for side, half in ((-1, low), (1, high)):
                # A plane's own cords run in both of its halves' skins, and cut no further.
                rest = [
                    a & (side * r[i] > 0) if c not in own[i] else a & False
                    for c, (a, r) in enumerate(zip(along, runs, strict=True))
                ]
                yield from self._cut(half, rest, todo[n + 1 :], (*planes, i), heights, runs, own)
            return
        yield Leaf(piece, planes)
