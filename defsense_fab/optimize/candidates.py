"""Many random but smooth variations of a cord, and their signals in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..core.arrays import Bool, Float, Int
from ..core.curve import Hermite, Plane, catmull_rom, curvature, hermite_basis
from ..core.device import Sensor
from ..core.mesh import Surface
from .constraints import (
    DepthField,
    depth_before_exit,
    extensions,
    run_lengths,
    separation,
    with_runs,
)
from .freedom import CordFreedom
from .nearest import nearest_strand
from .problem import Limits, Problem

_COARSE = 40  # points of a candidate's path


@dataclass(frozen=True)
class Pool:
    """Feasible candidates for one cord: sensors, paths (c, p, 3) mm, signals (n, c)."""

    sensors: tuple[Sensor, ...]
    paths: Float
    signals: Float

    def some(self, share: float, rng: np.random.Generator) -> Pool:
        """The first candidate and a random share of the others."""
        keep = rng.random(len(self.sensors)) < share
        keep[:1] = True
        which = np.flatnonzero(keep)
        return Pool(
            tuple(self.sensors[i] for i in which.tolist()),
            self.paths[which],
            self.signals[:, which],
        )


@dataclass(frozen=True)
class Batch:
    """Variations of cords as arrays: plane `origins` (c, 3) and `axes` (c, 3, 3), control
    `points` and `tangents` (c, k, 2), and the cord that each varies."""

    templates: tuple[Sensor, ...]
    origins: Float
    axes: Float
    points: Float
    tangents: Float

    def at(self, count: int) -> Int:
        """Which of a path's samples, 24 a span, `paths` takes."""
        last = 24 * (self.points.shape[1] - 1)
        return np.asarray(np.round(np.linspace(0, last, count)).astype(int))

    def paths(self, count: int) -> Float:
        """`count` points of each path, evenly spread over the parameter, (c, count, 3) mm."""
        few = hermite_basis(self.points.shape[1], 24)[0][self.at(count)]
        local = few @ np.concatenate([self.points, self.tangents], axis=1)
        return np.asarray(self.origins[:, None] + local @ self.axes[:, :, :2].swapaxes(1, 2))

    def take(self, which: Int) -> Batch:
        templates = tuple(self.templates[i] for i in which.tolist())
        return Batch(
            templates,
            *(a[which] for a in (self.origins, self.axes, self.points, self.tangents)),
        )

    def sensor(self, i: int) -> Sensor:
        return replace(
            self.templates[i],
            plane=Plane(self.origins[i], self.axes[i]),
            curve=Hermite(self.points[i], self.tangents[i]),
        )


def vary(sensor: Sensor, count: int, spread: float, rng: np.random.Generator) -> Batch:
    """The sensor itself and `count` variations; `spread` mm is the size of the largest ones.

    Planes are moved, rolled about the path's chord by up to 90 degrees either way, and tilted;
    paths take a sum of four sine waves over their chord. First and last control points and the
    end tangents stay in the plane.
    """
    k = len(sensor.curve.points)
    count = count if sensor.free else 0
    n = count + 1
    size = rng.uniform(0, 1, n) * spread  # small variations are the ones that a tight body takes
    size[0] = 0
    points = np.repeat(sensor.curve.points[None], n, axis=0)
    tangents = np.repeat(sensor.curve.tangents[None], n, axis=0)
    origins = np.repeat(sensor.plane.origin[None], n, axis=0)
    axes = np.repeat(sensor.plane.axes[None], n, axis=0)
    if "plane" in sensor.free:
        freedom = CordFreedom(sensor)
        angles = np.stack([rng.uniform(-np.pi / 2, np.pi / 2, n), rng.normal(0, 0.5, n)], axis=1)
        angles[0] = 0
        angles[:, 1] *= size / freedom.reach
        chord = sensor.curve.points[-1] - sensor.curve.points[0]
        turn = Rotation.from_euler("Z", np.arctan2(chord[1], chord[0]))
        roll = (turn * Rotation.from_euler("XY", angles) * turn.inv()).as_matrix()
        axes = sensor.plane.axes @ roll
        offset = rng.uniform(-1, 1, n) * size
        pivot = sensor.plane.to_world(freedom.center) + offset[:, None] * sensor.plane.normal
        origins = pivot - axes[:, :, :2] @ freedom.center
    if "path" in sensor.free and k > 4:
        t = np.linspace(0, 1, k)
        waves = np.sin(np.arange(1, 5)[:, None] * np.pi * t) / np.arange(1, 5)[:, None] ** 0.5
        wave = rng.normal(0, 0.5, (n, 4)) @ waves * size[:, None]
        chord = points[0, -1] - points[0, 0]
        length = np.linalg.norm(chord)
        side = np.array([-chord[1], chord[0]]) / length if length > 1e-6 else np.array([0, 1.0])
        points[:, 2:-2] += wave[:, 2:-2, None] * side
        new = catmull_rom(points[1:])
        tangents[1:, 1:-1] = new[:, 1:-1]
    return Batch((sensor,) * n, origins, axes, points, tangents)


def propose(surface: Surface, count: int, rng: np.random.Generator) -> list[Sensor]:
    """Straight cords through the body about its longest axis, in random planes."""
    depth = DepthField(surface)
    low, high = surface.bounds
    center = surface.vertices[surface.faces].mean((0, 1))
    _, _, axes = np.linalg.svd(surface.vertices - center, full_matrices=False)
    size = high - low
    s = np.linspace(-1, 1, 401) * float(np.linalg.norm(size)) / 2
    lines = []
    for _ in range(count):
        direction = axes[0] + rng.normal(0, 0.06, 3)
        direction /= np.linalg.norm(direction)
        normal = rng.normal(size=3)
        normal -= (normal @ direction) * direction
        normal /= np.linalg.norm(normal)
        side = rng.uniform(-0.4, 0.4, 2) @ axes[1:] * float(np.sort(size)[1])
        lines.append((center + side, direction, normal))
    points = np.stack([at + s[:, None] * direction for at, direction, _ in lines])
    within = depth(points.reshape(-1, 3))[0].reshape(count, -1) > 0
    out: list[Sensor] = []
    for (middle, direction, normal), inside in zip(lines, within, strict=True):
        if not inside[200]:
            continue
        gaps = np.flatnonzero(~inside)
        start, end = s[gaps[gaps < 200].max()] + 2, s[gaps[gaps > 200].min()] - 2
        length = end - start
        if length < 10:
            continue
        lead = min(8.0, length / 6)
        x = np.array([0, *np.linspace(lead, length - lead, 6), length])
        points = np.stack([x, np.zeros_like(x)], axis=1)
        plane = Plane.from_normal(middle + start * direction, normal, direction)
        out.append(
            Sensor(
                "proposed",
                plane,
                Hermite(points, catmull_rom(points)),
                frozenset({"path", "plane"}),
            )
        )
    return out


def build_pool(problem: Problem, batch: Batch, keep_first: bool = True) -> Pool:
    """Drop candidates that break a limit and compute the signals of the rest."""
    kept = _feasible(batch, problem.surface, problem.limits)
    if keep_first:
        kept = np.union1d([0], kept)
    batch = batch.take(kept)
    paths = batch.paths(_COARSE)
    return Pool(tuple(batch.sensor(i) for i in range(len(kept))), paths, problem.signals(paths))


def _feasible(batch: Batch, surface: Surface, limits: Limits) -> Int:
    """Indices of the candidates that keep wall, radius and distance from themselves."""
    depth = DepthField(surface)
    kept = np.arange(len(batch.points))

    def narrow(good: Bool) -> None:
        nonlocal batch, kept
        batch, kept = batch.take(np.flatnonzero(good)), kept[good]

    bend = np.abs(curvature(batch.points, batch.tangents, 6)).max(axis=1)
    narrow(np.asarray(bend * limits.min_radius < 0.98))
    for count in (8, _COARSE):  # most fail at a few points already
        paths = batch.paths(count)
        d = depth(paths.reshape(-1, 3))[0].reshape(paths.shape[:2])
        narrow(np.asarray(d.min(axis=1) > 0))
    if not len(kept):
        return kept
    paths = batch.paths(_COARSE)
    ends = extensions([batch.sensor(i) for i in range(len(kept))], depth, 11.0, 0.25)
    leaves = np.asarray(np.isfinite(ends).all(axis=1))
    narrow(leaves)
    if not len(kept):
        return kept
    none = np.zeros((_COARSE, 3, 0))
    ends = ends[leaves]
    runs = np.maximum(run_lengths(ends), 1e-3)  # the same number of samples for all
    paths = np.stack(
        [with_runs(p, none, e)[0] for p, e in zip(batch.paths(_COARSE), runs, strict=True)]
    )
    d = depth(paths.reshape(-1, 3))[0].reshape(paths.shape[:2])
    step = np.linalg.norm(np.diff(paths, axis=1), axis=2)
    along = np.concatenate([np.zeros((len(step), 1)), np.cumsum(step, axis=1)], axis=1)
    rest = ends - runs
    to_exit = np.minimum(along + rest[:, :1], along[:, -1:] - along + rest[:, 1:])
    good = np.asarray((d >= depth_before_exit(to_exit, limits)[0]).all(axis=1))
    for i in np.flatnonzero(good).tolist():
        strand = nearest_strand(paths[i], separation(limits))[0].min()
        good[i] = strand >= limits.clearance + step[i].max() / 4
    return kept[good]


def join(batches: Sequence[Batch]) -> Batch:
    """One batch of many; all need the same number of control points."""
    return Batch(
        tuple(t for b in batches for t in b.templates),
        *(
            np.concatenate([getattr(b, name) for b in batches])
            for name in ("origins", "axes", "points", "tangents")
        ),
    )
