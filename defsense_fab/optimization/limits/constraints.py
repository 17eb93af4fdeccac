"""Express wall, radius of curvature and clearance as inequalities g(x) >= 0 with derivatives."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import arc_lengths
from ...core.device.regions import hull_points
from ...core.mesh import Surface
from ...geometry.channels.channel_ends import MAX_INLET_SLOPE
from ...geometry.kernels.surface_queries import SignedDistance
from ..problem.cord_kinematics import PlacedCord, place_cord
from ..problem.cord_parameters import CordParameters
from ..problem.problem import Limits
from .inlets import MARGIN_MM, FullPath, Inlets, Mouth
from .polyline_distance import nearest_on_polyline, nearest_on_strand

_RADIUS_MARGIN = 1.05  # factor on the radius of curvature, for the same reason
_GROUP_SAMPLES = 3  # neighboring samples of which only the worst becomes an inequality
_NO_DISTANCE_MM = 1e3  # in place of an infinite distance
#: How far ends of paths in space move from where the surface was measured, which counts as flat.
FLAT_REACH_MM = 3.0


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


class Constraints:
    """All inequalities of a layout in mm; each is at least zero where it is met.

    The exits of the channels are measured at x = 0; for x nearby the surface there counts as flat.

    Args:
        surface: The body's surface.
        depth: Exact depth below it.
        limits: The limits.
        cords: Parameters of the cords.
        reach: How far the mouths of paths in space, and of those with free ends, may move, mm.
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
        self._inlets = [Inlets.of(c, depth, surface) for c in cords]

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
        limits, pads = self._limits, list[tuple[int, Mouth]]()
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
            sensor = tracks[i].placed.cord.sensor
            if not sensor.curve.is_planar or "ends" in sensor.free:
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


def _other_strand(path: Float, pad: Mouth, is_own: bool, limits: Limits) -> slice | None:
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
