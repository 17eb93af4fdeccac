"""Express wall, radius of curvature and clearance as inequalities g(x) >= 0 with derivatives."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

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
#: How far ends of paths in space move from where the surface was measured, which counts as flat.
FLAT_REACH_MM = 3.0
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

    def mouths(self, track: FullPath, lengths: Float, by_lengths: Float) -> list[_Mouth]:
        """Return the points where the channel leaves the body, as far as they exist.

        Args:
            track: The path with its runs.
            lengths: Distances (2,) mm of the path's ends from the surface.
            by_lengths: Their derivatives (2, size).
        """
        path, first, out = track.placed.points, RUN_SAMPLES * (self.runs[0] > 0), []
        for e, (end, before) in enumerate(((0, 1), (len(path) - 1, len(path) - 2))):
            if np.isfinite(lengths[e]):
                samples = np.array([end, before])
                mouth = _Mouth.of(track, samples, int(first), lengths[e], by_lengths[e])
                out.append(replace(mouth, normal=self.normals[e], start=self.exits[e]))
        return out


@dataclass(frozen=True)
class _Mouth:
    """A point where a channel leaves the body.

    Attributes:
        point: (3,) mm.
        by: Derivatives (3, size) of the point.
        normal: Unit normal (3,) of the surface, which counts as flat.
        start: Where the point (3,) was when the surface was measured, mm.
    """

    point: Float
    by: Float
    normal: Float
    start: Float

    @classmethod
    def of(
        cls, track: FullPath, samples: Int, first: int, length: float, by_length: Float
    ) -> _Mouth:
        """Extend a path beyond its sample `samples[0]`, away from `samples[1]`.

        Args:
            track: The path with its runs.
            samples: Numbers (2,) of the last sample of the path and the one before.
            first: Number of samples of the run before the path.
            length: Distance to the surface, mm.
            by_length: Its derivatives (size,).
        """
        end, before = track.placed.points[samples]
        step = end - before
        long = float(np.linalg.norm(step))
        out = step / long
        turn = length / long * (np.eye(3) - np.outer(out, out))
        by = np.zeros((6, len(by_length)))
        moves = np.concatenate([np.eye(3) + turn, -turn])
        track.add_rows(np.repeat(samples, 3) + first, moves, by)
        mouth = end + length * out
        return cls(mouth, by[:3] + by[3:] + np.outer(out, by_length), out, mouth)

    def pad_axis(self, depth: float) -> Float:
        """Return points (3, 3) from the skin to a depth (mm) below it, which move as the mouth."""
        return np.asarray(self.point - np.linspace(0, depth, 3)[:, None] * self.normal)


class Constraints:
    """All inequalities of a layout in mm; each is at least zero where it is met.

    The exits of the channels are measured at x = 0; for x nearby the surface there counts as flat.

    Args:
        surface: The body's surface.
        depth: Exact depth below it.
        limits: The limits.
        cords: Parameters of the cords.
        reach: How far the mouths of paths in space may move, mm.
    """

    def __init__(
        self,
        surface: Surface,
        depth: SignedDistance,
        limits: Limits,
        cords: Sequence[CordParameters],
        reach: float = FLAT_REACH_MM,
    ) -> None:
        self._reach = reach
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
        if self._limits.pad[0]:
            found = self._pad_margins(tracks)
            values += found[0]
            rows += found[1]
        return np.concatenate(values), np.concatenate(rows)

    def _pad_margins(self, tracks: Sequence[FullPath]) -> tuple[list[Float], list[Float]]:
        """Return the margins of the distances of pads from each other and from other strands."""
        limits, pads = self._limits, list[tuple[int, _Mouth]]()
        for i, (track, inlets) in enumerate(zip(tracks, self._inlets, strict=True)):
            mouths = inlets.mouths(track, *inlets.lengths(track, self._cords[i].size))
            pads += [(i, mouth) for mouth in mouths]
        values, rows = [], []
        for (i, one), (j, other) in itertools.combinations(pads, 2):
            a, b = one.pad_axis(limits.pad[1]), other.pad_axis(limits.pad[1])
            between = a[:, None] - b
            distance = np.linalg.norm(between, axis=2)
            worst = np.unravel_index(distance.argmin(), distance.shape)
            unit = between[worst] / max(float(distance[worst]), 1e-9)
            row = np.zeros((1, self._size))
            row[0, self._columns[i]] += unit @ one.by
            row[0, self._columns[j]] -= unit @ other.by
            values.append(distance[worst][None] - limits.pad_to_pad - MARGIN_MM)
            rows.append(row)
        for i, pad in pads:
            for j, track in enumerate(tracks):
                strand = _other_strand(track.points, pad, i == j, limits)
                if strand is None:
                    continue
                points = track.points[strand]
                distance, segment, where = nearest_on_polyline(pad.pad_axis(limits.pad[1]), points)
                p = int(distance.argmin())
                k, w = np.array([strand.start + segment[p]]), where[p]
                nearest = (1 - w) * track.points[k] + w * track.points[k + 1]
                unit = (pad.pad_axis(limits.pad[1])[p] - nearest) / max(float(distance[p]), 1e-9)
                row = self._rows(tracks, 1, (j, k, (w - 1) * unit), (j, k + 1, -w * unit))
                row[0, self._columns[i]] += unit[0] @ pad.by
                values.append(distance[p][None] - limits.pad_to_path - MARGIN_MM)
                rows.append(row)
        return values, rows

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
        for mouth in inlets.mouths(tracks[i], lengths, by):
            for allowed, gradient in self._limits.mouth_rooms(mouth.point[None]):
                wide = np.zeros((1, size))
                wide[0, self._columns[i]] = gradient[0] @ mouth.by
                values.append(allowed - MARGIN_MM)
                rows.append(wide)
            if not tracks[i].placed.cord.sensor.curve.is_planar:
                moved = mouth.point - mouth.start
                far = float(np.linalg.norm(moved))
                wide = np.zeros((1, size))
                wide[0, self._columns[i]] = -moved / max(far, 1e-9) @ mouth.by
                values.append(np.array([self._reach - far]))
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


def _other_strand(path: Float, pad: _Mouth, is_own: bool, limits: Limits) -> slice | None:
    """Return the samples of a path (p, 3) mm that keep away from a pad, or None.

    Of the pad's own path those do that are further along it than a bend away from the pad takes.
    """
    if not is_own:
        return slice(0, len(path))
    along = arc_lengths(path)
    free = pad_separation(limits)
    if np.linalg.norm(path[0] - pad.point) < np.linalg.norm(path[-1] - pad.point):
        strand = slice(int(np.searchsorted(along, free)), len(path))
    else:
        strand = slice(0, int(np.searchsorted(along, along[-1] - free)))
    return strand if strand.stop - strand.start > 1 else None


def pad_separation(limits: Limits) -> float:
    """Return the length along a path (mm) from its pad, from which it must keep away from it."""
    return limits.pad[1] + float(np.pi * max(limits.min_radius, limits.pad_to_path / 2))


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
