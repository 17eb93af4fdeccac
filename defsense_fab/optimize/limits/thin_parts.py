"""Parts too small or too thin to print, which cord planes leave where they nearly meet."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import group_coincident_planes, sample_path
from ...core.device.device import Sensor
from ...geometry.parts.cut_orders import cut_orders
from ..problem.cord_kinematics import place_cord
from ..problem.cord_parameters import CordParameters
from ..problem.problem import Problem, sample_interior

#: Points that stand for the body's volume, and for its surface, where the thinnest wedges end.
_VOLUME_POINTS, _SURFACE_POINTS = 3000, 1500
_MARGIN = 1.2  # what the points may miss
_MAX_NUMBERED_CELLS = 64  # cells, beyond which those without points are worth leaving out


@dataclass(frozen=True)
class Leaf:
    """A part: the cells that it is made of, and the distinct planes that bound it."""

    cells: int
    planes: tuple[int, ...]


class ThinParts:
    """Looks for slivers by points: the cuts of `geometry/parts/division.py` without solids."""

    def __init__(self, problem: Problem) -> None:
        rng = np.random.default_rng(0)
        volume, surface = sample_interior(problem, _VOLUME_POINTS, rng), problem.surface
        skin = surface.scatter(_SURFACE_POINTS, rng)
        self._points = np.concatenate([volume, surface.vertices[:_SURFACE_POINTS], skin])
        depth = problem.depth(volume)
        self._depth = np.concatenate([depth, np.zeros(len(self._points) - len(depth))])
        self._limits = problem.limits

    def __call__(self, sensors: Sequence[Sensor]) -> bool:
        """Whether the layout leaves slivers."""
        return self._first(sensors) is not None

    def guard(
        self, cords: Sequence[CordParameters], old: Float, new: Float
    ) -> tuple[Float, Float] | None:
        """An inequality at parameters `new` (size,) that rules out the sliver there: value (1,) mm
        and row (1, size); None without one. Thin parts that were thick at `old` are to be thick,
        others not to be."""
        ends = np.cumsum([0, *(c.size for c in cords)])
        parts = [slice(a, b) for a, b in itertools.pairwise(ends)]
        placed = [place_cord(c, new[p]) for c, p in zip(cords, parts, strict=True)]
        found = self._first([at.sensor() for at in placed])
        if found is None:
            return None
        was, value, row = 0.0, 0.0, np.zeros(len(new))
        point, owners = found
        for owner in owners:
            now, by = placed[owner].height(point)
            side = 1.0 if now >= 0 else -1.0
            value += side * now
            was += side * place_cord(cords[owner], old[parts[owner]]).height(point)[0]
            row[parts[owner]] += side * by
        if was > value:
            return np.array([value - 1.5 * max(value, self._limits.wall)]), row[None]
        return np.array([-value - 1e-2]), -row[None]

    def _first(self, sensors: Sequence[Sensor]) -> tuple[Float, tuple[int, ...]] | None:
        """The point deepest inside the thinnest sliver of the best order of cuts, and the cords
        whose planes are the nearest two there."""
        own = group_coincident_planes([s.plane for s in sensors])
        planes = [sensors[cords[0]].plane for cords in own]
        paths = [sample_path(s)[::6] for s in sensors]
        points = np.concatenate([self._points, *paths])
        heights = np.stack([(points - p.origin) @ p.normal for p in planes])
        cells, *along = np.split(
            _cells(heights), np.cumsum([len(self._points), *map(len, paths[:-1])])
        )
        heights = heights[:, : len(cells)]
        volume = (
            np.bincount(cells[:_VOLUME_POINTS], minlength=int(cells.max()) + 1) / _VOLUME_POINTS
        )
        above = [_cell_set(cells[h > 0]) for h in heights]
        parts: list[Leaf] = []
        best: tuple[int, float] | None = None
        for order in cut_orders(len(planes)):
            runs = [_cell_set(a) for a in along]
            leaves = list(_cut(_cell_set(cells), runs, list(order), (), own, above))
            rank = (len(leaves), -min(float(volume[_members(x.cells)].sum()) for x in leaves))
            if best is None or rank < best:
                best, parts = rank, leaves
        thin: list[tuple[float, Leaf, Int]] = []
        for leaf in parts:
            inside = np.flatnonzero(np.isin(np.arange(len(volume)), _members(leaf.cells))[cells])
            thickness = self._thickness(inside[inside < _VOLUME_POINTS], leaf, heights)
            share = float(volume[_members(leaf.cells)].sum())
            least = self._limits.wall, self._limits.smallest_part
            if thickness < _MARGIN * least[0] or share < _MARGIN * least[1]:
                thin.append((thickness, leaf, inside))
        if not thin:
            return None
        _, leaf, inside = min(thin, key=lambda x: x[0])
        near = np.abs(heights[list(leaf.planes)][:, inside])
        k = int(np.minimum(self._depth[inside], near.min(axis=0)).argmax())
        two = np.argsort(near[:, k], kind="stable")[:2]
        return self._points[inside[k]], tuple(own[leaf.planes[i]][0] for i in two.tolist())

    def _thickness(self, inside: Int, leaf: Leaf, heights: Float) -> float:
        """Mean thickness, mm: four times the mean distance from the faces, as in a slab."""
        if not len(inside):
            return 0.0
        near = self._depth[inside]
        for i in leaf.planes:
            near = np.minimum(near, np.abs(heights[i, inside]))
        return float(4 * near.mean())


def _cells(heights: Float) -> Int:
    """All planes together divide space into cells: the number (p,) of the one that each point is
    in, from its heights (i, p) above the planes. Only cells with points in them are numbered."""
    out = np.zeros(heights.shape[1], int)
    for above in heights > 0:
        out = 2 * out + above
        if out.max() > _MAX_NUMBERED_CELLS:
            out = np.unique(out, return_inverse=True)[1]
    return out


def _cell_set(cells: Int) -> int:
    """A set of cells as the bits of one number."""
    return sum(1 << c for c in np.flatnonzero(np.bincount(cells)).tolist())


def _members(cells: int) -> list[int]:
    return [c for c in range(cells.bit_length()) if cells >> c & 1]


def _cut(
    piece: int,
    along: list[int],
    todo: list[int],
    planes: tuple[int, ...],
    own: list[list[int]],
    above: list[int],
) -> Iterator[Leaf]:
    """The parts of a piece, a set of cells, for the planes still to cut; `along` are the cells that
    each cord runs through there, `own` each plane's cords and `above` the cells above it."""
    for n, i in enumerate(todo):
        if not any(along[c] for c in own[i]):
            continue
        low, high = piece & ~above[i], piece & above[i]
        if not (low and high):
            continue
        for half, side in ((low, ~above[i]), (high, above[i])):
            # A plane's own cords run in both of its halves' skins, and cut no further.
            rest = [0 if c in own[i] else a & side for c, a in enumerate(along)]
            yield from _cut(half, rest, todo[n + 1 :], (*planes, i), own, above)
        return
    yield Leaf(piece, planes)
