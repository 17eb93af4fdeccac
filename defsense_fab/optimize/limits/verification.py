"""An independent check of finished layouts on dense samples, apart from the optimiser's code.

Depth comes from the body's facets by winding number and closest points, inlets by rays, curvature
from the circle through three neighbouring samples, distances from a k-d tree over dense samples.
The straight runs from a path's ends to the surface are channels too, and are checked with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, format_point
from ...core.curve import arc_lengths, bend_radius, per_span_for_spacing, sample_path
from ...core.device.device import Sensor
from ...core.mesh import Surface
from ...geometry.channels.channel_ends import MAX_INLET_SLOPE
from ...geometry.kernels import surface_queries
from ...geometry.kernels.surface_queries import SignedDistance, signed_distance_of
from ..problem.problem import Limits
from .constraints import MAX_INLET_MM

_TOLERANCE_MM = 1e-3
_SPACING_MM = 0.25  # mm, between samples


@dataclass(frozen=True)
class LimitViolation:
    """A limit that a layout breaks.

    Attributes:
        code: Stable identifier of the kind of violation, such as `"wall-too-thin"`.
        message: One sentence for people.
        cords: Names of the cords that break the limit: one, or two that are too close.
        value: The measured quantity, mm.

    """

    code: str
    message: str
    cords: tuple[str, ...]
    value: float

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True)
class CordCheck:
    """Measured numbers of one cord and what it breaks; the samples (b, 3) mm where it does."""

    length: float
    min_radius: float
    min_wall: float
    inlets: tuple[float, float]
    problems: tuple[LimitViolation, ...]
    broken: Float


@dataclass(frozen=True)
class LayoutCheck:
    """All cords' numbers, least centre distance between different cords, and what is broken; the
    samples (b, 3) mm where it is."""

    cords: tuple[CordCheck, ...]
    min_clearance: float | None
    problems: tuple[LimitViolation, ...]
    broken: Float


def verify(
    sensors: Sequence[Sensor],
    surface: Surface,
    limits: Limits,
    depth: SignedDistance | None = None,
) -> LayoutCheck:
    """Check every cord and every pair on samples about 0.25 mm apart; `depth` below the surface,
    where it is known already."""
    depth = depth or signed_distance_of(surface)
    paths = [sample_path(s, per_span_for_spacing(s.curve, _SPACING_MM)) for s in sensors]
    cords = tuple(
        _check_cord(s, p, surface, limits, depth) for s, p in zip(sensors, paths, strict=True)
    )
    dense = [_with_runs(p, c.inlets) for p, c in zip(paths, cords, strict=True)]
    problems = [p for c in cords for p in c.problems]
    broken = [c.broken for c in cords]
    closest = None
    for i in range(len(sensors)):
        for j in range(i + 1, len(sensors)):
            gap, _ = cKDTree(dense[j]).query(dense[i])
            k = int(gap.argmin())
            closest = float(gap[k]) if closest is None else min(closest, float(gap[k]))
            if gap[k] < limits.clearance - _TOLERANCE_MM:
                problems.append(
                    LimitViolation(
                        "cords-too-close",
                        f"cords {sensors[i].name!r} and {sensors[j].name!r} come within"
                        f" {gap[k]:.2f} mm near {format_point(dense[i][k])}; {limits.clearance:.2f} mm is"
                        " needed",
                        (sensors[i].name, sensors[j].name),
                        float(gap[k]),
                    )
                )
                broken.append(dense[i][gap < limits.clearance - _TOLERANCE_MM])
    every = np.concatenate(broken) if broken else np.zeros((0, 3))
    return LayoutCheck(cords, closest, tuple(problems), every)


def _check_cord(
    sensor: Sensor, points: Float, surface: Surface, limits: Limits, depth_of: SignedDistance
) -> CordCheck:
    problems: list[LimitViolation] = []
    broken = [points[:0]]

    def add(code: str, value: float, message: str) -> None:
        problems.append(LimitViolation(code, message, (sensor.name,), float(value)))

    name = f"cord {sensor.name!r}"
    start, end = (
        _inlet_length(points[0], points[1], surface),
        _inlet_length(points[-1], points[-2], surface),
    )
    inlets = (start, end)
    path_depth = depth_of(points)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    length = float(step.sum())
    if path_depth.min() < -_TOLERANCE_MM:
        k = int(path_depth.argmin())
        add(
            "path-leaves-body",
            -path_depth[k],
            f"{name} leaves the body near {format_point(points[k])}, {-path_depth[k]:.2f} mm outside",
        )
        broken.append(points[path_depth < -_TOLERANCE_MM])
    for inlet, which in zip(inlets, ("start", "end"), strict=True):
        if inlet > MAX_INLET_MM and not problems:
            add(
                "end-far-from-surface",
                inlet,
                f"{name}: its {which} lies {inlet:.1f} mm from where it leaves the body; move the"
                f" end within {MAX_INLET_MM:g} mm of the surface",
            )
    whole = points if problems else _with_runs(points, inlets)
    depth = depth_of(whole)
    along = arc_lengths(whole)
    if not problems:
        to_exit = np.minimum(along, along[-1] - along)
        slack = depth - np.minimum(limits.depth, MAX_INLET_SLOPE * to_exit)
        k = int(slack.argmin())
        if slack[k] < -_TOLERANCE_MM:
            wall = depth[k] - limits.channel_diameter / 2
            add(
                "wall-too-thin",
                wall,
                f"{name} leaves a wall of {wall:.2f} mm near {format_point(whole[k])};"
                f" {limits.wall:.2f} mm is needed",
            )
            broken.append(whole[slack < -_TOLERANCE_MM])
    inside = np.minimum(along, along[-1] - along) >= limits.depth / MAX_INLET_SLOPE
    wall_depth = depth[inside].min() if inside.any() else depth.max()
    whole_length = length + sum(inlets)
    if not problems and not (
        limits.shortest - _TOLERANCE_MM <= whole_length <= limits.longest + _TOLERANCE_MM
    ):
        add(
            "channel-length-not-allowed",
            whole_length,
            f"{name} takes a channel of {whole_length:.1f} mm, and {limits.lengths} by [cord]"
            " length and min_stretch, with its pockets or free ends",
        )
    radius = bend_radius(points)
    if radius.min() < limits.min_radius - _TOLERANCE_MM:
        k = int(radius.argmin())
        add(
            "bend-too-tight",
            radius[k],
            f"{name} bends to a radius of {radius[k]:.2f} mm near {format_point(points[k + 1])};"
            f" {limits.min_radius:.2f} mm is needed",
        )
        broken.append(points[1:-1][radius < limits.min_radius - _TOLERANCE_MM])
    far = np.pi * max(limits.min_radius, limits.clearance / 2)
    few = slice(None, None, 4)
    a, s = whole[few], along[few]
    gap = np.linalg.norm(a[:, None] - a[None], axis=2)
    gap[np.abs(s[:, None] - s) < far + 1] = np.inf
    if gap.min() < limits.clearance - _TOLERANCE_MM:
        k = int(np.unravel_index(gap.argmin(), gap.shape)[0])
        add(
            "cord-near-itself",
            gap.min(),
            f"{name} comes within {gap.min():.2f} mm of itself near {format_point(a[k])};"
            f" {limits.clearance:.2f} mm is needed",
        )
        broken.append(a[(gap < limits.clearance - _TOLERANCE_MM).any(axis=1)])
    return CordCheck(
        length,
        float(radius.min()),
        float(wall_depth - limits.channel_diameter / 2),
        inlets,
        tuple(problems),
        np.concatenate(broken),
    )


def _inlet_length(end: Float, before: Float, surface: Surface) -> float:
    """How far a channel runs on straight from its path's end to the surface, mm."""
    found = surface_queries.hits(end, end - before, surface)
    return float(found[0]) if len(found) else float("inf")


def _with_runs(path: Float, inlets: tuple[float, float]) -> Float:
    """The path (p, 3) with samples of its straight runs to the surface."""

    def run(end: Float, before: Float, inlet: float) -> Float:
        if not 0.01 < inlet <= MAX_INLET_MM:
            return path[:0]
        out = (end - before) / np.linalg.norm(end - before)
        return end + np.linspace(0, inlet, int(np.ceil(inlet / _SPACING_MM)) + 1)[1:, None] * out

    start, end = run(path[0], path[1], inlets[0]), run(path[-1], path[-2], inlets[1])
    return np.concatenate([start[::-1], path, end])
