"""Find slivers: parts too small or too thin to print, left where cord planes nearly meet."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import group_coincident_planes, sample_path
from ...core.device.device import Sensor
from ...geometry.parts.division import cut_orders
from ..problem.cord_kinematics import place_cord
from ..problem.cord_parameters import CordParameters
from ..problem.problem import Problem, sample_interior

#: Points that sample the body's volume, and its surface, where the thinnest wedges end.
_VOLUME_POINTS, _SURFACE_POINTS = 3000, 1500
_MARGIN = 1.2  # safety factor for what the points miss
_MAX_NUMBERED_CELLS = 64  # from which on it pays to drop cells without points


@dataclass(frozen=True)
class Leaf:
    """A part of the body.

    Attributes:
        cells: Set of the cells it consists of, as the bits of a number.
        planes: Numbers of the distinct planes that bound it.
    """

    cells: int
    planes: tuple[int, ...]


class ThinParts:
    """Finds slivers from sample points: the cuts of `geometry/parts/division.py` without solids.

    Args:
        problem: The problem, whose body and limits apply.
    """

    def __init__(self, problem: Problem) -> None:
        rng = np.random.default_rng(0)
        volume, surface = sample_interior(problem, _VOLUME_POINTS, rng), problem.surface
        skin = surface.scatter(_SURFACE_POINTS, rng)
        self._points = np.concatenate([volume, surface.vertices[:_SURFACE_POINTS], skin])
        depth = problem.depth(volume)
        self._depth = np.concatenate([depth, np.zeros(len(self._points) - len(depth))])
        self._limits = problem.limits

    def __call__(self, sensors: Sequence[Sensor]) -> bool:
        """Return whether a layout leaves slivers."""
        return self._limits.is_cut and self._find_sliver(sensors) is not None

    def guard(
        self, cords: Sequence[CordParameters], old: Float, new: Float
    ) -> tuple[Float, Float] | None:
        """Return an inequality that rules out the sliver at new parameters.

        A thin part that was thicker at the old parameters must become thick; any other must vanish.

        Args:
            cords: Parameters of the cords.
            old: Old parameters (size,) mm.
            new: New parameters (size,) mm.

        Returns:
            Value (1,) mm and derivatives (1, size) of the inequality, or None without a sliver.
        """
        if not self._limits.is_cut:
            return None
        ends = np.cumsum([0, *(c.size for c in cords)])
        parts = [slice(a, b) for a, b in itertools.pairwise(ends)]
        placed = [place_cord(c, new[p]) for c, p in zip(cords, parts, strict=True)]
        sliver = self._find_sliver([at.sensor() for at in placed])
        if sliver is None:
            return None
        old_value, value, row = 0.0, 0.0, np.zeros(len(new))
        point, owners = sliver
        for owner in owners:
            height, by = placed[owner].height(point)
            side = 1.0 if height >= 0 else -1.0
            value += side * height
            old_value += side * place_cord(cords[owner], old[parts[owner]]).height(point)[0]
            row[parts[owner]] += side * by
        if old_value > value:
            return np.array([value - 1.5 * max(value, self._limits.wall)]), row[None]
        return np.array([-value - 1e-2]), -row[None]

    def _find_sliver(self, sensors: Sequence[Sensor]) -> tuple[Float, tuple[int, ...]] | None:
        """Return the point deepest inside the thinnest sliver, and the cords of its two planes.

        The order of cuts is the best one; the planes are the two nearest to the point.
        """
        plane_cords = group_coincident_planes([s.plane for s in sensors])
        planes = [sensors[cords[0]].plane for cords in plane_cords]
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
            leaves = list(_cut(_cell_set(cells), runs, list(order), (), plane_cords, above))
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
        distances = np.abs(heights[list(leaf.planes)][:, inside])
        k = int(np.minimum(self._depth[inside], distances.min(axis=0)).argmax())
        nearest_two = np.argsort(distances[:, k], kind="stable")[:2]
        return self._points[inside[k]], tuple(
            plane_cords[leaf.planes[i]][0] for i in nearest_two.tolist()
        )

    def _thickness(self, inside: Int, leaf: Leaf, heights: Float) -> float:
        """Return the mean thickness, mm: four times the mean distance from the faces."""
        if not len(inside):
            return 0.0
        near = self._depth[inside]
        for i in leaf.planes:
            near = np.minimum(near, np.abs(heights[i, inside]))
        return float(4 * near.mean())


def _cells(heights: Float) -> Int:
    """Number (p,) the cells of all planes that points are in, from heights (i, p) above the planes.

    Only cells that hold points are numbered.
    """
    out = np.zeros(heights.shape[1], int)
    for above in heights > 0:
        out = 2 * out + above
        if out.max() > _MAX_NUMBERED_CELLS:
            out = np.unique(out, return_inverse=True)[1]
    return out


def _cell_set(cells: Int) -> int:
    """Return a set of cells as the bits of one number."""
    return sum(1 << c for c in np.flatnonzero(np.bincount(cells)).tolist())


def _members(cells: int) -> list[int]:
    return [c for c in range(cells.bit_length()) if cells >> c & 1]


def _cut(
    piece: int,
    along: list[int],
    remaining: list[int],
    planes: tuple[int, ...],
    plane_cords: list[list[int]],
    above: list[int],
) -> Iterator[Leaf]:
    """Cut a piece, a set of cells, by the planes that remain, and yield its parts.

    `along` holds the cells that each cord runs through, `plane_cords` the cords of each plane and
    `above` the cells above it.
    """
    for n, i in enumerate(remaining):
        if not any(along[c] for c in plane_cords[i]):
            continue
        low, high = piece & ~above[i], piece & above[i]
        if not (low and high):
            continue
        for half, side in ((low, ~above[i]), (high, above[i])):
            # A plane's cords run in the cut faces of both halves and make no further cuts.
            rest = [0 if c in plane_cords[i] else a & side for c, a in enumerate(along)]
            yield from _cut(half, rest, remaining[n + 1 :], (*planes, i), plane_cords, above)
        return
    yield Leaf(piece, planes)
