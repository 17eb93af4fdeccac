"""Follow cords from their paths' ends straight to the surface, and find their mouths there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import arc_lengths
from ...core.device.device import Sensor
from ...core.machine import kernels
from ...core.mesh import Surface
from ...geometry.kernels import surface_queries
from ...geometry.kernels.surface_queries import SignedDistance
from ..problem.cord_kinematics import PlacedCord, place_cord
from ..problem.cord_parameters import CordParameters

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


@dataclass(frozen=True)
class Inlets:
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
    def of(cls, cord: CordParameters, depth: SignedDistance, surface: Surface) -> Inlets:
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

    def mouths(self, track: FullPath, lengths: Float, by_lengths: Float) -> list[Mouth]:
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
                mouth = Mouth.of(track, samples, int(first), lengths[e], by_lengths[e])
                out.append(replace(mouth, normal=self.normals[e], start=self.exits[e]))
        return out


@dataclass(frozen=True)
class Mouth:
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
    ) -> Mouth:
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
