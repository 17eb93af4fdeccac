"""Many random but smooth variations of a cord, and their signals in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Bool, Float
from ..core.curve import Hermite, Plane, catmull_rom, curvature
from ..core.device import Sensor
from ..core.mesh import Surface
from .constraints import MARGIN, DepthField, extensions, required_depth
from .freedom import CordFreedom
from .problem import Limits, Problem

_COARSE = 40  # points of a candidate's path


@dataclass(frozen=True)
class Pool:
    """Feasible candidates for one cord: sensors, paths (c, p, 3) mm, signals (n, c)."""

    sensors: tuple[Sensor, ...]
    paths: Float
    signals: Float


def vary(sensor: Sensor, count: int, spread: float, rng: np.random.Generator) -> list[Sensor]:
    """The sensor itself and `count` variations; `spread` mm is the size of the largest ones."""
    freedom = CordFreedom(sensor)
    out = [sensor]
    k = len(sensor.curve.points)
    t = np.linspace(0, 1, k)
    for _ in range(count if sensor.free else 0):
        moved = sensor
        if "plane" in sensor.free:
            x = np.zeros(freedom.size)
            roll = rng.uniform(-np.pi / 2, np.pi / 2) * freedom._reach
            x[-3:] = rng.uniform(-spread, spread), roll, rng.normal(0, spread / 2)
            moved = freedom.apply(x)
        if "path" in sensor.free and k > 4:
            points = moved.curve.points.copy()
            modes = rng.normal(0, spread / 2, 4) / np.arange(1, 5) ** 0.5
            wave = sum(a * np.sin((i + 1) * np.pi * t) for i, a in enumerate(modes))
            chord = points[-1] - points[0]
            length = np.linalg.norm(chord)
            side = np.array([-chord[1], chord[0]]) / length if length > 1e-6 else np.array([0, 1.0])
            points[2:-2] += np.asarray(wave)[2:-2, None] * side
            tangents = catmull_rom(points)
            tangents[0], tangents[-1] = moved.curve.tangents[0], moved.curve.tangents[-1]
            moved = replace(moved, curve=Hermite(points, tangents))
        out.append(moved)
    return out


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
        if end - start < 30:
            continue
        x = np.array(
            [0, 8, *np.linspace(8, end - start - 8, 6)[1:-1], end - start - 8, end - start]
        )
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


def build_pool(problem: Problem, sensors: Sequence[Sensor], keep_first: bool = True) -> Pool:
    """Drop candidates that break a limit and compute the signals of the rest."""
    paths = np.stack([s.plane.to_world(_resample(s.curve)) for s in sensors])
    good = _feasible(paths, sensors, problem.surface, problem.limits)
    if keep_first:
        good[0] = True
    kept = np.flatnonzero(good)
    if not len(kept):
        return Pool((), paths[:0], np.zeros((len(problem.markers), 0)))
    return Pool(tuple(sensors[i] for i in kept.tolist()), paths[kept], problem.signals(paths[kept]))


def _resample(curve: Hermite) -> Float:
    """_COARSE points, evenly spread over the parameter."""
    dense = curve.sample(24)
    return np.asarray(dense[np.round(np.linspace(0, len(dense) - 1, _COARSE)).astype(int)])


def _feasible(paths: Float, sensors: Sequence[Sensor], surface: Surface, limits: Limits) -> Bool:
    depth = DepthField(surface)
    d = depth(paths.reshape(-1, 3))[0].reshape(paths.shape[:2])
    good = d.min(1) > 0
    for i in np.flatnonzero(good).tolist():
        bend = np.abs(curvature(sensors[i].curve, 6)).max()
        good[i] = bend * limits.min_radius < 0.98 and not _crosses(paths[i], limits)
    left = np.flatnonzero(good).tolist()
    if left:
        ends = extensions([sensors[i] for i in left], depth, 11.0, 0.25)
        for i, e in zip(left, ends, strict=True):
            need = required_depth(paths[i], e, limits) + MARGIN
            good[i] = np.isfinite(e).all() and (d[i] >= need).all()
    return np.asarray(good)


def _crosses(path: Float, limits: Limits) -> bool:
    gap = np.linalg.norm(path[:, None] - path[None], axis=2)
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.concatenate([[0], np.cumsum(step)])
    gap[np.abs(along[:, None] - along) < np.pi * limits.min_radius + step.max()] = np.inf
    return bool(gap.min() < limits.clearance + step.max() / 2)
