"""Wall, radius of curvature and clearance as inequalities g(x) >= 0 with derivatives."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import arc_lengths
from ...core.device.device import Sensor
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row, copy_rows
from ...core.mesh import Surface
from ...geometry.channels.channel_ends import MAX_INLET_SLOPE
from ...geometry.kernels import surface_queries
from ...geometry.kernels.surface_queries import SignedDistance
from ..problem.cord_kinematics import PlacedCord, place_cord
from ..problem.cord_parameters import CordParameters
from ..problem.problem import Limits
from .polyline_distance import nearest_on_polyline, nearest_on_strand

# A cord's samples with its straight runs to the surface, and how they move with its parameters.

RUN_SAMPLES = 4  # samples of a straight run to the surface


@dataclass(frozen=True)
class FullPath:
    """Samples `points` (p, 3) mm in order: the run before the path's start, the path, the run
    after its end. Runs of `runs` (2,) mm follow the path's end tangents; a run of no length has
    no samples."""

    points: Float
    placed: PlacedCord
    runs: Float

    @classmethod
    def of(cls, placed: PlacedCord, runs: Float) -> FullPath:
        """The cord with runs of so many mm."""
        return cls(_with_runs(placed.points, runs), placed, runs)

    def add_rows(self, samples: Int, directions: Float, out: Float) -> None:
        """Add to out (q, size) the derivatives of how far the samples (q,) move along the
        directions (q, 3)."""
        rows, on, along = _on_path(samples, directions, self.runs, self.placed.points)
        self.placed.add_moves(rows, on, along, out)


@compiled()
def _with_runs(path, runs):  # type: ignore[no-untyped-def]
    a, b = RUN_SAMPLES * (runs[0] > 0), RUN_SAMPLES * (runs[1] > 0)
    count = len(path)
    out = np.empty((a + count + b, 3))
    copy_rows(path, out[a : a + count])
    for end, before, number, length in ((0, 1, a, runs[0]), (count - 1, count - 2, b, runs[1])):
        if number:
            step = path[end] - path[before]
            step *= length / np.sqrt((step**2).sum()) / RUN_SAMPLES
            for k in range(number):
                at = a - 1 - k if end == 0 else a + count + k
                copy_row(path[end] + (k + 1) * step, out[at])
    return out


@compiled()
def _on_path(samples, directions, runs, path):  # type: ignore[no-untyped-def]
    """What moves the samples (q,) along the directions (q, 3), told by the path's own samples:
    which of the q (m,), the path's sample (m,), its direction (m, 3)."""
    a, count = RUN_SAMPLES * (runs[0] > 0), len(path)
    rows, on = np.empty(2 * len(samples), np.int64), np.empty(2 * len(samples), np.int64)
    along = np.empty((2 * len(samples), 3))
    m = 0
    for q in range(len(samples)):
        i = samples[q] - a
        if 0 <= i < count:
            rows[m], on[m] = q, i
            copy_row(directions[q], along[m])
            m += 1
            continue
        # A run's sample turns with the path's last step.
        if i < 0:
            end, before, s = 0, 1, -i * runs[0] / RUN_SAMPLES
        else:
            end, before, s = count - 1, count - 2, (i - count + 1) * runs[1] / RUN_SAMPLES
        step = path[end] - path[before]
        size = np.sqrt((step**2).sum())
        step /= size
        across = (directions[q] - step * (step * directions[q]).sum()) * s / size
        rows[m], on[m], rows[m + 1], on[m + 1] = q, end, q, before
        copy_row(directions[q] + across, along[m])
        copy_row(-across, along[m + 1])
        m += 2
    return rows[:m], on[:m], along[:m]


#: An end further than this from the surface leaves cord that the signal does not count, mm.
MAX_INLET_MM = 12.0
#: Part of the limits that the optimiser keeps in hand for what its samples miss, mm.
MARGIN_MM = 0.1
_RADIUS_MARGIN = 1.05  # the same for the radius of curvature
_NO_DISTANCE_MM = 1e3


def exit_distances(sensor: Sensor, surface: Surface) -> Float:
    """How far (mm) the path's two ends run on straight before they leave the body, (2,); inf where
    an end does not leave."""
    ends = sensor.plane.to_world(sensor.curve.points[[0, -1]])
    tangents = sensor.curve.tangents[[0, -1]] @ sensor.plane.axes[:, :2].T
    found = [
        surface_queries.hits(e, t, surface)
        for e, t in zip(ends, [-tangents[0], tangents[1]], strict=True)
    ]
    return np.array([hits[0] if len(hits) else np.inf for hits in found])


def run_lengths(ends: Float) -> Float:
    """How much of the straight runs of `ends` mm to the surface is sampled: not the last 2 mm,
    whose length changes as a plane tilts."""
    return np.asarray(np.where(np.isfinite(ends) & (ends > 2.1), ends - 2, 0))


def required_depth(to_exit: Float, limits: Limits) -> tuple[Float, Float]:
    """Least depth `to_exit` mm of channel before the surface, with a margin, and how it grows with
    that: the full wall, also beside a pocket at the end, less in the cone of an inlet."""
    length, diameter = limits.pocket
    slope = MAX_INLET_SLOPE * (1 + MARGIN_MM / limits.depth)
    wide = max(limits.wall + diameter / 2, limits.depth)
    full = np.where(to_exit < length, wide, limits.depth) + MARGIN_MM
    cone = slope * to_exit
    return np.minimum(full, cone), np.where(cone < full, slope, 0.0)


@dataclass(frozen=True)
class _Inlets:
    """A cord's channel near its two ends, as measured at x = 0, and the limits `least` and `most`
    (2,) mm of how far the ends may lie from the surface: as drawn at the worst.

    The `normals` (2, 3) of the surface and the `exits` (2, 3) mm where the straight runs of
    `runs` (2,) mm leave it; for each sample the length of channel `along` (p,) mm to the nearer
    end of the track, and which `end` (p,) that is; samples `near` (q,) an end, where limits
    change quickly, and `far` from both.
    """

    normals: Float
    exits: Float
    runs: Float
    least: Float
    most: Float
    near: Int
    far: Int
    along: Float
    end: Int

    @classmethod
    def of(cls, cord: CordParameters, depth: SignedDistance, surface: Surface) -> _Inlets:
        lengths = exit_distances(cord.sensor, surface)
        runs = run_lengths(lengths)
        track = FullPath.of(place_cord(cord, np.zeros(cord.size)), runs)
        points, path = track.points, track.placed.points
        out = path[[0, -1]] - path[[1, -2]]
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        finite = np.isfinite(lengths)
        exits = path[[0, -1]] + np.where(finite, lengths, 0.0)[:, None] * out
        below = exits - 0.01 * out  # on the surface itself rounding decides what is inside
        normals = np.where(finite[:, None], -depth.with_gradient(below)[1], 0.0)
        along = arc_lengths(points)
        i = np.arange(len(points))
        near = np.minimum(i, i[::-1]) < 12 + RUN_SAMPLES
        both = np.stack([along, along[-1] - along])
        least = np.minimum(5 * MARGIN_MM, lengths)
        most = np.maximum(MAX_INLET_MM - 5 * MARGIN_MM, np.where(finite, lengths, 0.0))
        ends = (both.min(axis=0), both.argmin(axis=0))
        return cls(normals, exits, runs, least, most, i[near], i[~near], *ends)

    def lengths(self, track: FullPath, size: int) -> tuple[Float, Float]:
        """How far the path's ends lie from the surface at the exits, (2,) mm, inf without one, and
        the derivatives (2, size)."""
        value, row = np.full(2, np.inf), np.zeros((2, size))
        path = track.placed.points
        count, first = len(path), RUN_SAMPLES * (self.runs[0] > 0)
        for e, (end, before) in enumerate(((0, 1), (count - 1, count - 2))):
            step = path[end] - path[before]
            long = np.linalg.norm(step)
            out, n = step / long, self.normals[e]
            slant = n @ out
            if slant < 1e-3:
                continue
            value[e] = n @ (self.exits[e] - path[end]) / slant
            turn = value[e] / long * (n - slant * out) / slant
            samples = np.array([end, before]) + first
            rows = np.zeros((2, size))
            track.add_rows(samples, np.stack([-n / slant - turn, turn]), rows)
            row[e] = rows.sum(axis=0)
        return value, row


class Constraints:
    """All inequalities of a layout, in mm, each at least zero where it is met.

    Where the channels leave the body is measured at x = 0: for x nearby the surface there counts
    as flat.
    """

    def __init__(
        self,
        surface: Surface,
        depth: SignedDistance,
        limits: Limits,
        cords: Sequence[CordParameters],
        stride: int = 3,
    ) -> None:
        self._depth, self._limits, self._stride, self._cords = depth, limits, stride, cords
        sizes = np.cumsum([0, *(c.size for c in cords)])
        self._columns = [slice(a, b) for a, b in itertools.pairwise(sizes)]
        self._size = int(sizes[-1])
        self._inlets = [_Inlets.of(c, depth, surface) for c in cords]

    def __call__(self, x: Float) -> tuple[Float, Float]:
        """Values (g,) and derivatives (g, size)."""
        tracks = [
            FullPath.of(place_cord(cord, x[columns]), inlets.runs)
            for cord, columns, inlets in zip(self._cords, self._columns, self._inlets, strict=True)
        ]
        values, rows = [], []
        free = [i for i, c in enumerate(self._cords) if c.size]
        depth, inward = self._depth.with_gradient(np.concatenate([tracks[i].points for i in free]))
        done = 0
        for i in free:
            part = slice(done, done + len(tracks[i].points))
            done = part.stop
            found = self._walls(tracks, i, depth[part], inward[part])
            values += found[0]
            rows += found[1]
        radius = self._limits.min_radius
        for cord, track, columns in zip(self._cords, tracks, self._columns, strict=True):
            if len(cord.rows):
                room, by = track.placed.turning(_RADIUS_MARGIN * radius)
                worst = _worst_of_groups(room, self._stride)
                wide = np.zeros((len(worst), self._size))
                wide[:, columns] = radius * by[worst]
                values.append(radius * room[worst])
                rows.append(wide)
        for i in range(len(tracks)):
            for j in range(i, len(tracks)):
                if self._cords[i].size or self._cords[j].size:
                    value, row = self._distance(tracks, i, j)
                    values.append(value)
                    rows.append(row)
        return np.concatenate(values), np.concatenate(rows)

    def _walls(
        self, tracks: Sequence[FullPath], i: int, depth: Float, inward: Float
    ) -> tuple[list[Float], list[Float]]:
        """What the depths (q,) of a cord's samples have in hand, and inlets' and cord's lengths."""
        inlets, size = self._inlets[i], self._size
        lengths, by = inlets.lengths(tracks[i], self._cords[i].size)
        rest = lengths - inlets.runs
        need, growth = required_depth(inlets.along + rest[inlets.end], self._limits)
        room = depth - need
        worst = inlets.far[_worst_of_groups(room[inlets.far], self._stride)]
        few = np.sort(np.concatenate([inlets.near, worst]))
        row = self._rows(tracks, len(few), (i, few, inward[few]))
        tilt = np.zeros_like(row)
        tilt[:, self._columns[i]] = growth[few, None] * by[inlets.end[few]]
        leaves = np.isfinite(lengths)
        longer = np.zeros((int(leaves.sum()), size))
        longer[:, self._columns[i]] = by[leaves]
        values = [room[few], (lengths - inlets.least)[leaves], (inlets.most - lengths)[leaves]]
        rows = [row - tilt, longer, -longer]
        for bound, sign in ((self._limits.shortest, 1), (self._limits.longest, -1)):
            if 0 < bound < np.inf:
                long, by_long = _length(tracks[i].placed)
                left = long + lengths[leaves].sum() - bound
                wide = np.zeros((1, size))
                wide[0, self._columns[i]] = sign * (by_long + by[leaves].sum(axis=0))
                values.append(np.array([sign * left - MARGIN_MM]))
                rows.append(wide)
        return values, rows

    def _rows(
        self, tracks: Sequence[FullPath], count: int, *terms: tuple[int, Int, Float]
    ) -> Float:
        """Sums (count, size) of how far samples move: terms of cord, samples (count,), and
        directions (count, 3)."""
        out = np.zeros((count, self._size))
        for cord, samples, directions in terms:
            tracks[cord].add_rows(samples, directions, out[:, self._columns[cord]])
        return out

    def _distance(self, tracks: Sequence[FullPath], i: int, j: int) -> tuple[Float, Float]:
        """Every few neighbouring samples of cord i: the one nearest to cord j (or to i's far
        parts). All samples are looked at; a coarser polyline would cut the bends short."""
        a, b = tracks[i].points, tracks[j].points
        if i == j:
            distance, segment, where = nearest_on_strand(a, strand_separation(self._limits))
        else:
            distance, segment, where = nearest_on_polyline(a, b)
        p = _worst_of_groups(distance, self._stride)
        k, best, w = segment[p], distance[p], where[p][:, None]
        unit = (a[p] - (1 - w) * b[k] - w * b[k + 1]) / np.maximum(best, 1e-9)[:, None]
        unit[~np.isfinite(best)] = 0.0
        row = self._rows(
            tracks, len(p), (i, p, unit), (j, k, (w - 1) * unit), (j, k + 1, -w * unit)
        )
        return np.where(
            np.isfinite(best), best, _NO_DISTANCE_MM
        ) - self._limits.clearance - MARGIN_MM, row


def _length(placed: PlacedCord) -> tuple[float, Float]:
    """Length of the path, mm, and the derivative (size,)."""
    step = np.diff(placed.points, axis=0)
    size = np.linalg.norm(step, axis=1)
    unit = step / np.maximum(size, 1e-12)[:, None]
    none = np.zeros((1, 3))
    by_points = np.concatenate([none, unit]) - np.concatenate([unit, none])
    return float(size.sum()), placed.pull_one(by_points)


def _worst_of_groups(values: Float, count: int) -> Int:
    """Index of the smallest of every `count` neighbours; looking at all of them misses nothing
    and keeps the rows few."""
    padded = np.append(values, np.full(-len(values) % count, np.inf)).reshape(-1, count)
    return np.asarray(padded.argmin(axis=1) + count * np.arange(len(padded)))


def strand_separation(limits: Limits) -> float:
    """Length along one cord from which on two of its points count as separate strands, mm."""
    return float(np.pi * max(limits.min_radius, limits.clearance / 2))
