"""Express wall, radius of curvature and clearance as inequalities g(x) >= 0 with derivatives."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import arc_lengths
from ...core.device.device import Sensor
from ...core.device.regions import hull_points
from ...core.machine import kernels
from ...core.mesh import Surface
from ...geometry.channels.channel_ends import MAX_INLET_SLOPE
from ...geometry.kernels import surface_queries
from ...geometry.kernels.surface_queries import SignedDistance
from ..problem.cord_kinematics import PlacedCord, place_cord
from ..problem.cord_parameters import CordParameters
from ..problem.problem import Limits
from .polyline_distance import nearest_on_polyline, nearest_on_strand

RUN_SAMPLES = 4  # of a straight run to the surface


@dataclass(frozen=True)
class FullPath:
    """A cord's path with its straight runs to the surface, which follow the path's end tangents.

    Attributes:
        points: (p, 3) mm, samples in order: the run before the path's start, the path, the run
            after its end. A run of zero length has no samples.
        placed: The cord.
        runs: (2,) mm, lengths of the runs.
    """

    points: Float
    placed: PlacedCord
    runs: Float

    @classmethod
    def of(cls, placed: PlacedCord, runs: Float) -> FullPath:
        """Extend a cord by runs (2,) mm."""
        points = np.empty((len(placed.points) + RUN_SAMPLES * int((runs > 0).sum()), 3))
        kernels.add_runs(placed.points, runs, RUN_SAMPLES, points)
        return cls(points, placed, runs)

    def add_rows(self, samples: Int, directions: Float, out: Float) -> None:
        """Add to `out` the derivatives of the motion of samples along directions.

        Args:
            samples: (q,) numbers of the samples.
            directions: (q, 3) directions.
            out: (q, size), changed in place.
        """
        kernels.add_path_moves(
            self.placed.motion, self.placed.points, self.runs, RUN_SAMPLES, samples, directions, out
        )


MAX_INLET_MM = 12.0  # from a path's end to the surface; the signal ignores the cord in between
MARGIN_MM = 0.1  # added to the limits for what the optimizer's samples miss
_RADIUS_MARGIN = 1.05  # factor on the radius of curvature, for the same reason
_GROUP_SAMPLES = 3  # neighboring samples of which only the worst becomes an inequality
_NO_DISTANCE_MM = 1e3  # in place of an infinite distance


def exit_distances(sensor: Sensor, surface: Surface) -> Float:
    """Return the lengths (2,) mm of the straight runs from a path's ends to the surface.

    A length is infinite if the run does not leave the body.
    """
    ends = sensor.plane.to_world(sensor.curve.points[[0, -1]])
    tangents = sensor.plane.turn(sensor.curve.tangents[[0, -1]])
    rays = [
        surface_queries.cast_ray(e, t, surface)
        for e, t in zip(ends, [-tangents[0], tangents[1]], strict=True)
    ]
    return np.array([hits[0] if len(hits) else np.inf for hits in rays])


def run_lengths(ends: Float) -> Float:
    """Return the sampled lengths of straight runs of `ends` mm to the surface.

    The last 2 mm are left out, because their length changes as a plane tilts.
    """
    return np.asarray(np.where(np.isfinite(ends) & (ends > 2.1), ends - 2, 0))


def required_depth(to_exit: Float, limits: Limits) -> tuple[Float, Float]:
    """Return the smallest depth allowed before a channel's exit, with a margin.

    It is the full wall, also next to a pocket at the end, and less in the cone of an inlet.

    Args:
        to_exit: Length of channel to the surface, mm.
        limits: The limits.

    Returns:
        Depths in mm and their derivatives by `to_exit`.
    """
    length, diameter = limits.pocket
    slope = MAX_INLET_SLOPE * (1 + MARGIN_MM / limits.depth)
    wide = max(limits.wall + diameter / 2, limits.depth)
    full = np.where(to_exit < length, wide, limits.depth) + MARGIN_MM
    cone = slope * to_exit
    return np.minimum(full, cone), np.where(cone < full, slope, 0.0)


@dataclass(frozen=True)
class _Inlets:
    """A cord's channel near its two ends, as measured at x = 0.

    Attributes:
        normals: (2, 3) normals of the surface at the exits.
        exits: (2, 3) mm, points where the straight runs leave the body.
        runs: (2,) mm, sampled lengths of the runs.
        shortest: (2,) mm, smallest distances allowed from the ends to the surface; never stricter
            than the drawing.
        longest: (2,) mm, the largest distances.
        near: (q,) numbers of samples near an end, where limits change quickly.
        away: (r,) numbers of the other samples.
        along: (p,) mm, length of channel from each sample to the nearer end of the full path.
        end: (p,) number of that end.
    """

    normals: Float
    exits: Float
    runs: Float
    shortest: Float
    longest: Float
    near: Int
    away: Int
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
        inner = exits - 0.01 * out  # on the surface rounding would decide what is inside
        normals = np.where(finite[:, None], -depth.with_gradient(inner)[1], 0.0)
        along = arc_lengths(points)
        i = np.arange(len(points))
        near = np.minimum(i, i[::-1]) < 12 + RUN_SAMPLES
        distances = np.stack([along, along[-1] - along])
        shortest = np.minimum(5 * MARGIN_MM, lengths)
        longest = np.maximum(MAX_INLET_MM - 5 * MARGIN_MM, np.where(finite, lengths, 0.0))
        ends = (distances.min(axis=0), distances.argmin(axis=0))
        return cls(normals, exits, runs, shortest, longest, i[near], i[~near], *ends)

    def lengths(self, track: FullPath, size: int) -> tuple[Float, Float]:
        """Return the distances of the path's ends from the surface along the runs.

        Returns:
            Distances (2,) mm, infinite without an exit, and derivatives (2, size).
        """
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

    def mouth_margins(
        self, track: FullPath, lengths: Float, by_lengths: Float, limits: Limits
    ) -> tuple[Float, Float]:
        """Return how far the exits that exist are inside what is allowed for mouths.

        Args:
            track: The path with its runs.
            lengths: Distances (2,) mm of the path's ends from the surface.
            by_lengths: Their derivatives (2, size).
            limits: The limits.

        Returns:
            Margins (m,) mm and derivatives (m, size).
        """
        path, first = track.placed.points, RUN_SAMPLES * (self.runs[0] > 0)
        values, rows = [], []
        for e, (end, before) in enumerate(((0, 1), (len(path) - 1, len(path) - 2))):
            if not np.isfinite(lengths[e]):
                continue
            step = path[end] - path[before]
            long = np.linalg.norm(step)
            out = step / long
            for room, gradient in limits.mouth_rooms((path[end] + lengths[e] * out)[None]):
                slope = gradient[0]
                turn = lengths[e] / long * (slope - (slope @ out) * out)
                two, moves = np.zeros((2, by_lengths.shape[1])), np.stack([slope + turn, -turn])
                track.add_rows(np.array([end, before]) + first, moves, two)
                values.append(room[0] - MARGIN_MM)
                rows.append(two.sum(axis=0) + (slope @ out) * by_lengths[e])
        return np.array(values), np.array(rows).reshape(-1, by_lengths.shape[1])


class Constraints:
    """All inequalities of a layout in mm; each is at least zero where it is met.

    The exits of the channels are measured at x = 0; for x nearby the surface there counts as flat.

    Args:
        surface: The body's surface.
        depth: Exact depth below it.
        limits: The limits.
        cords: Parameters of the cords.
    """

    def __init__(
        self,
        surface: Surface,
        depth: SignedDistance,
        limits: Limits,
        cords: Sequence[CordParameters],
    ) -> None:
        self._depth, self._limits, self._cords = depth, limits, cords
        sizes = np.cumsum([0, *(c.size for c in cords)])
        self._columns = [slice(a, b) for a, b in itertools.pairwise(sizes)]
        self._size = int(sizes[-1])
        self._inlets = [_Inlets.of(c, depth, surface) for c in cords]

    def __call__(self, x: Float) -> tuple[Float, Float]:
        """Return values (g,) and derivatives (g, size) at parameters x (size,)."""
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
                worst = _worst_of_groups(room)
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
        """Return the margins of a cord's depths (q,), its inlets' lengths and its whole length."""
        inlets, size = self._inlets[i], self._size
        lengths, by = inlets.lengths(tracks[i], self._cords[i].size)
        rest = lengths - inlets.runs
        need, growth = required_depth(inlets.along + rest[inlets.end], self._limits)
        room = depth - need
        worst = inlets.away[_worst_of_groups(room[inlets.away])]
        chosen = np.sort(np.concatenate([inlets.near, worst]))
        row = self._rows(tracks, len(chosen), (i, chosen, inward[chosen]))
        tilt = np.zeros_like(row)
        tilt[:, self._columns[i]] = growth[chosen, None] * by[inlets.end[chosen]]
        leaves = np.isfinite(lengths)
        longer = np.zeros((int(leaves.sum()), size))
        longer[:, self._columns[i]] = by[leaves]
        values = [
            room[chosen],
            (lengths - inlets.shortest)[leaves],
            (inlets.longest - lengths)[leaves],
        ]
        rows = [row - tilt, longer, -longer]
        if self._limits.kept_whole:
            found = self._kept_margins(tracks, i)
            values += found[0]
            rows += found[1]
        margins, by_mouth = inlets.mouth_margins(tracks[i], lengths, by, self._limits)
        wide = np.zeros((len(margins), size))
        wide[:, self._columns[i]] = by_mouth
        values.append(margins)
        rows.append(wide)
        for bound, sign in ((self._limits.shortest, 1), (self._limits.longest, -1)):
            if 0 < bound < np.inf:
                length, by_length = _length(tracks[i].placed)
                slack = length + lengths[leaves].sum() - bound
                wide = np.zeros((1, size))
                wide[0, self._columns[i]] = sign * (by_length + by[leaves].sum(axis=0))
                values.append(np.array([sign * slack - MARGIN_MM]))
                rows.append(wide)
        return values, rows

    def _kept_margins(self, tracks: Sequence[FullPath], i: int) -> tuple[list[Float], list[Float]]:
        """Return the margins of a cord's channel and of its cut to regions that are kept whole."""
        room, away = self._limits.room_to_kept(tracks[i].points)
        worst = _worst_of_groups(room)
        values = [room[worst] - MARGIN_MM]
        rows = [self._rows(tracks, len(worst), (i, worst, away[worst]))]
        placed = tracks[i].placed
        if placed.cord.has_plane and self._limits.is_cut:
            for shape in self._limits.kept_whole:
                heights = [placed.height(point) for point in hull_points(shape)]
                side = 1.0 if np.mean([h for h, _ in heights]) >= 0 else -1.0
                height, by = min(heights, key=lambda pair: side * pair[0])
                wide = np.zeros((1, self._size))
                wide[0, self._columns[i]] = side * by
                values.append(np.array([side * height - MARGIN_MM]))
                rows.append(wide)
        return values, rows

    def _rows(
        self, tracks: Sequence[FullPath], count: int, *terms: tuple[int, Int, Float]
    ) -> Float:
        """Return derivatives (count, size) of sums of samples' motions along directions.

        Each term holds a cord, its samples (count,) and directions (count, 3).
        """
        out = np.zeros((count, self._size))
        for cord, samples, directions in terms:
            tracks[cord].add_rows(samples, directions, out[:, self._columns[cord]])
        return out

    def _distance(self, tracks: Sequence[FullPath], i: int, j: int) -> tuple[Float, Float]:
        """Return margins of the distance of cord i from cord j, or from its own other strands.

        Of every few neighboring samples only the nearest becomes a row. All samples are compared,
        because a coarser polyline would cut the bends short.
        """
        a, b = tracks[i].points, tracks[j].points
        if i == j:
            distance, segment, where = nearest_on_strand(a, strand_separation(self._limits))
        else:
            distance, segment, where = nearest_on_polyline(a, b)
        p = _worst_of_groups(distance)
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
    """Return the length of the path, mm, and its derivative (size,)."""
    step = np.diff(placed.points, axis=0)
    size = np.linalg.norm(step, axis=1)
    unit = step / np.maximum(size, 1e-12)[:, None]
    none = np.zeros((1, 3))
    by_points = np.concatenate([none, unit]) - np.concatenate([unit, none])
    return float(size.sum()), placed.pull_one(by_points)


def _worst_of_groups(values: Float) -> Int:
    """Return the index of the smallest value of each group of neighbors."""
    count = _GROUP_SAMPLES
    padded = np.append(values, np.full(-len(values) % count, np.inf)).reshape(-1, count)
    return np.asarray(padded.argmin(axis=1) + count * np.arange(len(padded)))


def strand_separation(limits: Limits) -> float:
    """Return the length along a cord (mm) from which two points are on separate strands."""
    return float(np.pi * max(limits.min_radius, limits.clearance / 2))
