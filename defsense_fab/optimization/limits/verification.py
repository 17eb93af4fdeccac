"""Check finished layouts on dense samples, independently of the optimizer's code.

Depth comes from the body's facets by winding number and closest points, inlets from rays, curvature
from the circle through three neighboring samples and on both sides of control points, where it
jumps, and distances from a k-d tree over dense samples.
The straight runs from a path's ends to the surface are channels too and are checked as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, format_point
from ...core.curve import (
    arc_lengths,
    bend_radius,
    curvature,
    per_span_for_spacing,
    sample_path,
)
from ...core.device.device import Sensor
from ...core.device.regions import Shape, hull_points, inset
from ...core.mesh import Surface
from ...geometry.channels.channel_ends import MAX_INLET_SLOPE
from ...geometry.kernels import surface_queries
from ...geometry.kernels.surface_queries import SignedDistance, signed_distance_of
from ..problem.problem import Limits
from .constraints import pad_separation
from .inlets import MAX_INLET_MM

_TOLERANCE_MM = 1e-3
_SPACING_MM = 0.25  # of samples


@dataclass(frozen=True)
class LimitViolation:
    """A limit that a layout breaks.

    Attributes:
        code: Stable identifier of the kind of violation, such as `"wall-too-thin"`.
        message: One sentence for people.
        cords: Names of the cords that break the limit: one, or two that are too close.
        value: The measured quantity, mm.
        at: Where the limit is broken (3,), mm; the middle of a cord that breaks it as a whole.
    """

    code: str
    message: str
    cords: tuple[str, ...]
    value: float
    at: tuple[float, float, float]

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True)
class CordCheck:
    """Measured numbers of one cord.

    Attributes:
        length: Length of the path, mm.
        min_radius: Smallest radius of curvature, mm.
        min_wall: Smallest wall away from the inlets, mm.
        inlets: Lengths of the straight runs from the path's ends to the surface, mm; infinite where
            a run does not leave the body.
        violations: Limits that the cord breaks.
        broken: (b, 3) mm, samples where it breaks them.
    """

    length: float
    min_radius: float
    min_wall: float
    inlets: tuple[float, float]
    violations: tuple[LimitViolation, ...]
    broken: Float


@dataclass(frozen=True)
class LayoutCheck:
    """Measured numbers of a layout.

    Attributes:
        cords: The numbers of each cord.
        min_clearance: Smallest distance of the center lines of two cords, mm; None for one cord.
        violations: All limits that are broken.
        broken: (b, 3) mm, samples where they are.
    """

    cords: tuple[CordCheck, ...]
    min_clearance: float | None
    violations: tuple[LimitViolation, ...]
    broken: Float


def verify(
    sensors: Sequence[Sensor],
    surface: Surface,
    limits: Limits,
    depth: SignedDistance | None = None,
) -> LayoutCheck:
    """Check every cord and every pair of cords on samples about 0.25 mm apart.

    Args:
        sensors: The cords.
        surface: The body's surface.
        limits: What the layout must keep.
        depth: Depth below the surface, computed if not given.
    """
    depth = depth or signed_distance_of(surface)
    paths = [sample_path(s, per_span_for_spacing(s.curve, _SPACING_MM)) for s in sensors]
    cords = tuple(
        _check_cord(s, p, surface, limits, depth) for s, p in zip(sensors, paths, strict=True)
    )
    dense = [_with_runs(p, c.inlets) for p, c in zip(paths, cords, strict=True)]
    violations = [v for c in cords for v in c.violations]
    broken = [c.broken for c in cords]
    closest = None
    for i in range(len(sensors)):
        for j in range(i + 1, len(sensors)):
            gap, _ = cKDTree(dense[j]).query(dense[i])
            k = int(gap.argmin())
            closest = float(gap[k]) if closest is None else min(closest, float(gap[k]))
            if gap[k] < limits.clearance - _TOLERANCE_MM:
                names = (sensors[i].name, sensors[j].name)
                message = (
                    f"{limits.noun}s {names[0]!r} and {names[1]!r} come within {gap[k]:.2f} mm near"
                    f" {format_point(dense[i][k])}; {limits.clearance:.2f} mm is needed"
                )
                violations.append(
                    _violation("cords-too-close", message, names, gap[k], dense[i][k])
                )
                broken.append(dense[i][gap < limits.clearance - _TOLERANCE_MM])
    if limits.pad[0] and sensors:
        closeness = _check_pads([s.name for s in sensors], dense, limits, surface, depth)
        violations += [violation for violation, _ in closeness]
        broken += [point[None] for _, point in closeness]
    every = np.concatenate(broken) if broken else np.zeros((0, 3))
    return LayoutCheck(cords, closest, tuple(violations), every)


def _check_pads(
    names: Sequence[str],
    dense: Sequence[Float],
    limits: Limits,
    surface: Surface,
    depth: SignedDistance,
) -> list[tuple[LimitViolation, Float]]:
    """Check the distances of pads, upright on the skin, from each other and from other strands.

    Args:
        names: Names of the traces.
        dense: Their samples (p, 3) from skin to skin, mm.
        limits: The limits.
        surface: The body's surface.
        depth: Depth below it.

    Returns:
        Violations, each with a place (3,) mm.
    """
    depths = np.linspace(0, limits.pad[1], 12)[:, None]
    ends = [(i, end, dense[i][end]) for i in range(len(dense)) for end in (0, -1)]
    inward = -surface.normals[depth.closest(np.array([mouth for *_, mouth in ends]))[1]]
    axes = [mouth + depths * n for (*_, mouth), n in zip(ends, inward, strict=True)]
    found: list[tuple[LimitViolation, Float]] = []

    def compare(i: int, j: int, axis: Float, others: Float, needed: float, what: str) -> None:
        gap, _ = cKDTree(others).query(axis)
        k = int(gap.argmin())
        if gap[k] < needed - _TOLERANCE_MM:
            message = (
                f"a pad of trace {names[i]!r} comes within {gap[k]:.2f} mm of {what} trace"
                f" {names[j]!r} near {format_point(axis[k])}; {needed:.2f} mm is needed"
            )
            involved = (names[i],) if i == j else (names[i], names[j])
            violation = _violation("pad-too-close", message, involved, gap[k], axis[k])
            found.append((violation, axis[k]))

    for n, (i, end, _) in enumerate(ends):
        for m in range(n):
            compare(i, ends[m][0], axes[n], axes[m], limits.pad_to_pad, "a pad of")
        for j, samples in enumerate(dense):
            others = samples
            if i == j:
                along = arc_lengths(samples)
                far = along if end == 0 else along[-1] - along
                others = samples[far > pad_separation(limits)]
            if len(others):
                compare(i, j, axes[n], others, limits.pad_to_path, "the line of")
    return found


def _violation(
    code: str, message: str, cords: tuple[str, ...], value: float, at: Float
) -> LimitViolation:
    x, y, z = (float(coordinate) for coordinate in at)
    return LimitViolation(code, message, cords, float(value), (x, y, z))


class _Findings:
    """The violations of one cord and the samples where they occur."""

    def __init__(self, name: str, noun: str, middle: Float) -> None:
        self._name, self._noun, self._middle = name, noun, middle
        self.violations: list[LimitViolation] = []
        self.broken: list[Float] = []

    def add(
        self,
        code: str,
        value: float,
        text: str,
        samples: Float | None = None,
        at: Float | None = None,
    ) -> None:
        """Add a violation at a place (3,) mm, or in the middle of the broken samples (b, 3) mm."""
        message = f"{self._noun} {self._name!r}{text}"
        if at is None:
            at = self._middle if samples is None else samples[len(samples) // 2]
        self.violations.append(_violation(code, message, (self._name,), value, at))
        if samples is not None:
            self.broken.append(samples)


def _check_cord(
    sensor: Sensor, points: Float, surface: Surface, limits: Limits, depth_of: SignedDistance
) -> CordCheck:
    findings = _Findings(sensor.name, limits.noun, points[len(points) // 2])
    start = _inlet_length(points[0], points[1], surface)
    end = _inlet_length(points[-1], points[-2], surface)
    inlets = (start, end)
    path_depth = depth_of(points)
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if path_depth.min() < -_TOLERANCE_MM:
        k = int(path_depth.argmin())
        findings.add(
            "path-leaves-body",
            -path_depth[k],
            f" leaves the body near {format_point(points[k])}, {-path_depth[k]:.2f} mm outside",
            points[path_depth < -_TOLERANCE_MM],
        )
    for inlet, which, at in zip(inlets, ("start", "end"), points[[0, -1]], strict=True):
        if inlet > MAX_INLET_MM and not findings.violations:
            findings.add(
                "end-far-from-surface",
                inlet,
                f": its {which} lies {inlet:.1f} mm from where it leaves the body; move the end"
                f" within {MAX_INLET_MM:g} mm of the surface",
                at=at,
            )
    leaves = not findings.violations
    if leaves and limits.exits:
        _check_exits(points, inlets, limits, findings)
    whole = _with_runs(points, inlets) if leaves else points
    depth, along = depth_of(whole), arc_lengths(whole)
    for shape in limits.kept_whole:
        _check_kept(sensor, whole, shape, limits, findings)
    if leaves:
        _check_walls(whole, depth, along, limits, findings)
    inside = np.minimum(along, along[-1] - along) >= limits.depth / MAX_INLET_SLOPE
    wall_depth = depth[inside].min() if inside.any() else depth.max()
    _check_length(length + sum(inlets), limits, findings)
    radius = _bend_radii(sensor, points)
    _check_radius(points, radius, limits, findings)
    _check_strands(whole, along, limits, findings)
    return CordCheck(
        length,
        float(radius.min()),
        float(wall_depth - limits.channel_diameter / 2),
        inlets,
        tuple(findings.violations),
        np.concatenate([points[:0], *findings.broken]),
    )


def _bend_radii(sensor: Sensor, points: Float) -> Float:
    """Return radii of curvature (p - 2,) mm at the inner samples of a path (p, 3).

    Circles through samples miss a bend shorter than their spacing next to a control point.
    """
    curve = sensor.curve
    spans = len(curve.points) - 1
    at_ends = np.abs(curvature(curve.points, curve.tangents, 1)).reshape(spans, 2)
    sharpest = np.append(at_ends[:, 0], 0.0)
    sharpest[1:] = np.maximum(sharpest[1:], at_ends[:, 1])
    radii = np.full(len(points), np.inf)
    radii[:: (len(points) - 1) // spans] = 1 / np.maximum(sharpest, 1e-9)
    radii[1], radii[-2] = min(radii[:2]), min(radii[-2:])  # those at the ends, too
    return np.asarray(np.minimum(bend_radius(points), radii[1:-1]))


def _check_exits(
    points: Float, inlets: tuple[float, float], limits: Limits, findings: _Findings
) -> None:
    """Check that both ends of a path (p, 3) mm leave the body in an allowed region."""
    ends = ((points[0], points[1], "start"), (points[-1], points[-2], "end"))
    for (end, before, which), inlet in zip(ends, inlets, strict=True):
        mouth = end + inlet * (end - before) / np.linalg.norm(end - before)
        if limits.exit_room(mouth[None])[0][0] < -_TOLERANCE_MM:
            findings.add(
                "exit-not-allowed",
                inlet,
                f": its {which} leaves the body at {format_point(mouth)}, outside of the regions of"
                " [wires] exit",
                mouth[None],
            )


def _check_kept(
    sensor: Sensor, whole: Float, shape: Shape, limits: Limits, findings: _Findings
) -> None:
    """Check that no channel with samples (p, 3) mm, pad or cut crosses a kept region."""
    distance, needed = -inset(shape, whole)[0], np.full(len(whole), limits.depth)
    if limits.pad[0]:
        needed[[0, -1]] = limits.wall + limits.pad_reach
    near = distance < needed - _TOLERANCE_MM
    if near.any():
        at = whole[int((distance - needed).argmin())]
        findings.add(
            "kept-region-crossed",
            distance.min(),
            f" comes too near a region of [fabrication] keep_whole near {format_point(at)}",
            whole[near],
        )
    if limits.is_cut and sensor.curve.is_planar:
        heights = (hull_points(shape) - sensor.plane.origin) @ sensor.plane.normal
        if heights.min() < -_TOLERANCE_MM and heights.max() > _TOLERANCE_MM:
            depth = float(min(-heights.min(), heights.max()))
            findings.add(
                "kept-region-cut",
                depth,
                f": its plane cuts a region of [fabrication] keep_whole, {depth:.1f} mm deep",
            )


def _check_walls(
    whole: Float, depth: Float, along: Float, limits: Limits, findings: _Findings
) -> None:
    """Check the wall of a channel with samples (p, 3) at depths (p,) and arc lengths (p,) mm."""
    to_exit = np.minimum(along, along[-1] - along)
    slack = depth - np.minimum(limits.depth, MAX_INLET_SLOPE * to_exit)
    k = int(slack.argmin())
    if slack[k] < -_TOLERANCE_MM:
        wall = depth[k] - limits.channel_diameter / 2
        findings.add(
            "wall-too-thin",
            wall,
            f" leaves a wall of {wall:.2f} mm near {format_point(whole[k])};"
            f" {limits.wall:.2f} mm is needed",
            whole[slack < -_TOLERANCE_MM],
        )


def _check_length(length: float, limits: Limits, findings: _Findings) -> None:
    """Check the length (mm) of a channel from surface to surface."""
    allowed = limits.shortest - _TOLERANCE_MM <= length <= limits.longest + _TOLERANCE_MM
    if not findings.violations and not allowed:
        findings.add(
            "channel-length-not-allowed",
            length,
            f" takes a channel of {length:.1f} mm, and {limits.lengths} by [cord] length and"
            " min_stretch, with its pockets or free ends",
        )


def _check_radius(points: Float, radius: Float, limits: Limits, findings: _Findings) -> None:
    """Check radii of curvature (p - 2,) mm at the inner samples of a path (p, 3)."""
    if radius.min() < limits.min_radius - _TOLERANCE_MM:
        k = int(radius.argmin())
        findings.add(
            "bend-too-tight",
            radius[k],
            f" bends to a radius of {radius[k]:.2f} mm near {format_point(points[k + 1])};"
            f" {limits.min_radius:.2f} mm is needed",
            points[1:-1][radius < limits.min_radius - _TOLERANCE_MM],
        )


def _check_strands(whole: Float, along: Float, limits: Limits, findings: _Findings) -> None:
    """Check the distance of a channel from its own other strands, on every fourth sample."""
    separation = np.pi * max(limits.min_radius, limits.clearance / 2)
    every_fourth = slice(None, None, 4)
    a, s = whole[every_fourth], along[every_fourth]
    gap = np.linalg.norm(a[:, None] - a[None], axis=2)
    gap[np.abs(s[:, None] - s) < separation + 1] = np.inf
    if gap.min() < limits.clearance - _TOLERANCE_MM:
        k = int(np.unravel_index(gap.argmin(), gap.shape)[0])
        findings.add(
            "cord-near-itself",
            gap.min(),
            f" comes within {gap.min():.2f} mm of itself near {format_point(a[k])};"
            f" {limits.clearance:.2f} mm is needed",
            a[(gap < limits.clearance - _TOLERANCE_MM).any(axis=1)],
        )


def _inlet_length(end: Float, before: Float, surface: Surface) -> float:
    """Return the length (mm) of the straight run from a path's end to the surface, or infinity."""
    hits = surface_queries.cast_ray(end, end - before, surface)
    return float(hits[0]) if len(hits) else float("inf")


def _with_runs(path: Float, inlets: tuple[float, float]) -> Float:
    """Return the path (p, 3) with samples of its straight runs to the surface."""

    def run(end: Float, before: Float, inlet: float) -> Float:
        if not 0.01 < inlet <= MAX_INLET_MM:
            return path[:0]
        out = (end - before) / np.linalg.norm(end - before)
        return end + np.linspace(0, inlet, int(np.ceil(inlet / _SPACING_MM)) + 1)[1:, None] * out

    start, end = run(path[0], path[1], inlets[0]), run(path[-1], path[-2], inlets[1])
    return np.concatenate([start[::-1], path, end])
