"""Fit the path of a cord again: cut to the body, extended to its surface, or with fewer points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...core.arrays import Float, longest_run
from ...core.curve import arc_lengths, per_span_for_spacing, resample, sample_path
from ...core.curve_conversion import MIN_FIT_POINTS, fit_curve
from ...core.device.device import Sensor
from ...core.mesh import Surface
from ...geometry.kernels import surface_queries
from ...geometry.kernels.surface_queries import SignedDistance
from ..limits.inlets import MAX_INLET_MM
from ..problem.cord_kinematics import place_cord
from ..problem.cord_parameters import CordParameters

_SPACING_MM = 0.5  # of samples
_END_DEPTH_MM = 1.0  # of a path's end below the surface, along the path
_FIT_TOLERANCE_MM = 0.3
_EXTRA_POINTS = 3  # that the fit of a path may need in addition to its own
_MIN_LENGTH_MM = 4.0  # of a path
_TRIM_MM = 8.0  # of the ends of a path
_PULLS = 30  # steps of a pull into the body
_PULL_DAMPING = 1e-3


def refitted_paths(sensor: Sensor, surface: Surface, depth: SignedDistance) -> Iterator[Sensor]:
    """Yield the cord with its path cut to the body, and then with fewer and fewer points.

    The path is the longest part of the cord's path inside the body, extended straight to the
    surface, just below which it ends. Further paths leave out the last millimeters, whose
    direction may be wrong. Nothing is yielded for a cord outside the body.

    Args:
        sensor: The cord.
        surface: The body's surface.
        depth: Depth below it.
    """
    points = sample_path(sensor, per_span_for_spacing(sensor.curve, _SPACING_MM))
    count = max(len(sensor.curve.points), MIN_FIT_POINTS)
    inside = points[longest_run(depth(points) > 0)]
    for trim in (0.0, _TRIM_MM):
        line = _line_to_surface(inside, trim, surface)
        if line is None:
            continue
        if sensor.curve.is_planar:
            line = ((line - sensor.plane.origin) @ sensor.plane.axes)[:, :2]
        close = fit_curve(line, _FIT_TOLERANCE_MM, (count, count + _EXTRA_POINTS))
        yield replace(sensor, curve=close)
        for fewer in range(count - 1, MIN_FIT_POINTS - 1, -1):
            yield replace(sensor, curve=fit_curve(line, _FIT_TOLERANCE_MM, (fewer, fewer)))


def pull_into_body(sensor: Sensor, depth: SignedDistance) -> Sensor:
    """Return the cord moved and turned with its plane, or bent in space, into the body.

    Args:
        sensor: The cord, part of which may be outside.
        depth: Depth below the body's surface.
    """
    free = frozenset({"plane"} if sensor.curve.is_planar else {"path", "ends"})
    cord = CordParameters(replace(sensor, free=free))
    x = np.zeros(cord.size)
    for _ in range(_PULLS):
        placed = place_cord(cord, x)
        depths, inward = depth.with_gradient(placed.points)
        is_out = depths < _END_DEPTH_MM
        if not is_out.any():
            break
        moves = np.zeros((*placed.points.shape, int(is_out.sum())))
        moves[np.flatnonzero(is_out), :, np.arange(moves.shape[2])] = inward[is_out]
        by = placed.pull(moves).T
        normal = by.T @ by + _PULL_DAMPING * len(by) * np.eye(cord.size)
        x = x + np.linalg.solve(normal, by.T @ (_END_DEPTH_MM - depths[is_out]))
    return replace(place_cord(cord, x).sensor(), free=sensor.free)


def ends_at_surface(sensor: Sensor, surface: Surface, depth: SignedDistance) -> bool:
    """Return whether both ends are inside the body and run straight to its surface nearby."""
    points = sample_path(sensor, per_span_for_spacing(sensor.curve, _SPACING_MM))
    ends = ((0, 1), (-1, -2))
    runs = [_run(points[end] - points[before], points[end], surface) for end, before in ends]
    return bool(depth(points[[0, -1]]).min() > 0) and max(runs) <= MAX_INLET_MM


def _line_to_surface(line: Float, trim: float, surface: Surface) -> Float | None:
    """Return a line (q, 3) mm without `trim` mm at both ends, extended to below the surface."""
    length = float(arc_lengths(line)[-1]) if len(line) > 1 else 0.0
    if length < 2 * trim + _MIN_LENGTH_MM:
        return None
    line = resample(line, trim, length - trim, int(length / _SPACING_MM) + 2)
    outside = []
    for end, before in ((0, 1), (-1, -2)):
        out = line[end] - line[before]
        run = _run(out, line[end], surface)
        if not np.isfinite(run):
            return None
        outside.append(line[end] + run * out / np.linalg.norm(out))
    line = np.concatenate([outside[0][None], line, outside[1][None]])
    length = float(arc_lengths(line)[-1])
    return resample(line, _END_DEPTH_MM, length - _END_DEPTH_MM, int(length / _SPACING_MM) + 2)


def _run(out: Float, end: Float, surface: Surface) -> float:
    hits = surface_queries.cast_ray(end, out, surface)
    return float(hits[0]) if len(hits) else float("inf")
