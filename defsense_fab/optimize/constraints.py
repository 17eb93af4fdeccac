"""Wall, radius of curvature and clearance as inequalities g(x) >= 0 with derivatives."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import igl
import numpy as np

from ..core.arrays import Float, Int
from ..core.device import Sensor
from ..core.mesh import Surface
from .freedom import CordFreedom
from .nearest import nearest, nearest_strand
from .problem import Limits

#: A channel may enter at up to this slope: depth gained per length of channel.
INLET_SLOPE = 0.6
#: Part of the limits that the optimiser keeps in hand for what its samples miss, mm.
MARGIN = 0.1
_FAR = 1e3
_RUN = 4  # samples of a straight run to the surface


class DepthField:
    """Distance below the surface (positive inside), with its gradient."""

    def __init__(self, surface: Surface) -> None:
        self._v = np.ascontiguousarray(surface.vertices)
        self._f = np.ascontiguousarray(surface.faces)
        # Kept between queries: building these trees costs far more than one query.
        self._tree, self._winding = igl.AABB(), igl.FastWindingNumberBVH()
        self._tree.init(self._v, self._f)
        self._winding.init(self._v, self._f)
        a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        self._inward = -normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)

    def __call__(self, points: Float) -> tuple[Float, Float]:
        """Depth (p,) mm and gradient (p, 3) at points (p, 3)."""
        points = np.ascontiguousarray(points)
        square, face, closest = self._tree.squared_distance(self._v, self._f, points)
        inside = np.asarray(self._winding.winding_number(points)) > 0.5
        depth = np.sqrt(np.asarray(square)) * np.where(inside, 1.0, -1.0)
        away = points - np.asarray(closest)
        size = np.linalg.norm(away, axis=1, keepdims=True)
        direction = np.where(
            size > 1e-9,
            away / np.maximum(size, 1e-9) * np.sign(depth)[:, None],
            self._inward[np.asarray(face)],
        )
        return depth, direction


def extensions(
    sensors: Sequence[Sensor], depth: DepthField, longest: float = 50.0, step: float = 0.05
) -> Float:
    """How far (mm) each cord's two ends run on straight before they leave the body, (c, 2).

    inf where an end does not leave within `longest` mm.
    """
    ends = np.stack([s.plane.to_world(s.curve.points[[0, -1]]) for s in sensors])
    out = np.stack([s.curve.tangents[[0, -1]] @ s.plane.axes[:, :2].T for s in sensors])
    out = out / np.linalg.norm(out, axis=2, keepdims=True) * np.array([[-1.0], [1.0]])
    s = np.arange(0, longest + step, step)
    points = ends[:, :, None] + s[:, None] * out[:, :, None]
    d = depth(points.reshape(-1, 3))[0].reshape(len(sensors), 2, len(s))
    outside = d <= 0
    i = outside.argmax(axis=2)
    before = np.maximum(i - 1, 0)
    a, b = (np.take_along_axis(d, k[..., None], 2)[..., 0] for k in (before, i))
    exit_at = s[before] + np.where(i > 0, step * a / np.where(a - b > 0, a - b, 1), 0.0)
    return np.asarray(np.where(outside.any(axis=2), exit_at, np.inf))


def run_lengths(ends: Float) -> Float:
    """How much of the straight runs of `ends` mm to the surface is sampled: not the last 2 mm,
    whose length changes as a plane tilts."""
    return np.asarray(np.where(np.isfinite(ends), np.maximum(ends - 2, 0), 0))


def with_runs(points: Float, derivative: Float, runs: Float) -> tuple[Float, Float]:
    """A path (p, 3) and its derivative (p, 3, size) with straight runs of `runs` (2,) mm."""
    out, by = [points], [derivative]
    for end, before, length in ((0, 1, runs[0]), (-1, -2, runs[1])):
        if not length:
            continue
        step, by_step = points[end] - points[before], derivative[end] - derivative[before]
        size = np.linalg.norm(step)
        unit = step / size
        by_unit = (by_step - np.outer(unit, unit @ by_step)) / size
        s = length * (np.arange(_RUN) + 1)[:, None] / _RUN
        run = points[end] + s * unit
        by_run = derivative[end] + s[..., None] * by_unit
        out = [run[::-1], *out] if end == 0 else [*out, run]
        by = [by_run[::-1], *by] if end == 0 else [*by, by_run]
    return np.concatenate(out), np.concatenate(by)


def depth_before_exit(to_exit: Float, limits: Limits) -> tuple[Float, Float]:
    """Least depth `to_exit` mm of channel before the surface, with a margin, and its derivative.

    The full wall, less in the cone of an inlet.
    """
    full, slope = limits.depth + MARGIN, INLET_SLOPE * (1 + MARGIN / limits.depth)
    need = np.minimum(full, slope * to_exit)
    return need, np.where(need < full, slope, 0.0)


def required_depth(
    points: Float, derivative: Float, ends: Float, limits: Limits
) -> tuple[Float, Float]:
    """Least depth (p,) of samples (p, 3) that end `ends` (2,) mm before the exits, with a margin.

    Also its derivative (p, size), from that of the samples (p, 3, size).
    """
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    by = np.einsum("pj,pjx->px", step / length[:, None], np.diff(derivative, axis=0))
    along = np.concatenate([[0], np.cumsum(length)])
    by_along = np.concatenate([np.zeros((1, by.shape[1])), np.cumsum(by, axis=0)])
    start, end = along + ends[0], along[-1] - along + ends[1]
    by_exit = np.where((start < end)[:, None], by_along, by_along[-1] - by_along)
    need, slope = depth_before_exit(np.minimum(start, end), limits)
    return need, slope[:, None] * by_exit


class Constraints:
    """All inequalities of a layout, in mm, each at least zero where it is met."""

    def __init__(
        self, surface: Surface, limits: Limits, cords: Sequence[CordFreedom], stride: int = 3
    ) -> None:
        self._depth, self._limits, self._cords = DepthField(surface), limits, cords
        self._stride = stride
        self._free = [c.size > 0 for c in cords]
        self._ends = extensions([c.sensor for c in cords], self._depth)
        self._runs = run_lengths(self._ends)
        sizes = np.cumsum([0, *(c.size for c in cords)])
        self._columns = [slice(a, b) for a, b in itertools.pairwise(sizes)]
        self._size = int(sizes[-1])

    def __call__(self, x: Float) -> tuple[Float, Float]:
        """Values (g,) and derivatives (g, size)."""
        values: list[Float] = []
        rows: list[Float] = []
        paths = [
            with_runs(*c.path(x[s]), runs)
            for c, s, runs in zip(self._cords, self._columns, self._runs, strict=True)
        ]
        for i, (cord, columns) in enumerate(zip(self._cords, self._columns, strict=True)):
            if not self._free[i]:
                continue
            points, derivative = paths[i]
            need, by_need = required_depth(
                points, derivative, self._ends[i] - self._runs[i], self._limits
            )
            few = self._samples(len(points))
            p, d = points[few], derivative[few]
            depth, direction = self._depth(p)
            values.append(depth - need[few])
            by_depth = np.einsum("pj,pjx->px", direction, d)
            rows.append(self._widen(by_depth - by_need[few], columns))
            if "path" in cord.sensor.free:
                kappa, by = cord.curvature(x[columns])
                few = _worst_of_each(-np.abs(kappa), self._stride)
                tight = 1.05 * self._limits.min_radius * kappa[few]
                values.append(5 * (1 - tight**2))
                by_tight = 1.05 * self._limits.min_radius * by[few]
                rows.append(self._widen(-10 * tight[:, None] * by_tight, columns))
        for i in range(len(paths)):
            for j in range(i, len(paths)):
                if self._free[i] or self._free[j]:
                    self._distance(paths, i, j, values, rows)
        return np.concatenate(values), np.concatenate(rows)

    def _samples(self, count: int) -> Int:
        """Every few samples, and all near the ends, where the inlets' limits change quickly."""
        i = np.arange(count)
        near = np.minimum(i, count - 1 - i) < 12 + _RUN
        return np.flatnonzero(near | (i % self._stride == 0))

    def _widen(self, row: Float, columns: slice) -> Float:
        out = np.zeros((len(row), self._size))
        out[:, columns] = row
        return out

    def _distance(
        self,
        paths: Sequence[tuple[Float, Float]],
        i: int,
        j: int,
        values: list[Float],
        rows: list[Float],
    ) -> None:
        """Every few neighbouring samples of cord i: the one nearest to cord j (or to i's far
        parts). All samples are looked at; a coarser polyline would cut the bends short."""
        (a, da), (b, db) = paths[i], paths[j]
        if i == j:
            distance, segment, where = nearest_strand(a, separation(self._limits))
        else:
            distance, segment, where = nearest(a, b)
        p = _worst_of_each(distance, self._stride)
        k, best, w = segment[p], distance[p], where[p][:, None]
        some = np.isfinite(best)  # SLSQP wants the same rows every time
        unit = (a[p] - (1 - w) * b[k] - w * b[k + 1]) / np.maximum(best, 1e-9)[:, None]
        row = self._widen(np.einsum("pj,pjx->px", unit, da[p]), self._columns[i])
        w = w[..., None]
        row -= self._widen(
            np.einsum("pj,pjx->px", unit, (1 - w) * db[k] + w * db[k + 1]), self._columns[j]
        )
        values.append(np.where(some, best, _FAR) - self._limits.clearance - MARGIN)
        rows.append(np.where(some[:, None], row, 0.0))


def _worst_of_each(values: Float, count: int) -> Int:
    """Index of the smallest of every `count` neighbours; looking at all of them misses nothing
    and keeps the rows few."""
    padded = np.append(values, np.full(-len(values) % count, np.inf)).reshape(-1, count)
    return np.asarray(padded.argmin(axis=1) + count * np.arange(len(padded)))


def separation(limits: Limits) -> float:
    """Length along one cord from which on two of its points count as separate strands, mm."""
    return float(np.pi * max(limits.min_radius, limits.clearance / 2))
