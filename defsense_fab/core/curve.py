"""Paths of sensors: planes, cubic Hermite curves in a plane or in space, and points along them.

Points lie at uniform curve parameters, the same number in every span, so that they depend linearly
on control points and tangents: the derivatives of the optimizer rely on that. How many points are
needed depends on the use: a total number for signals, a spacing for distances, a sag for solids.
Points that must be evenly spaced along the length are resampled from them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from .arrays import Float

#: Least number of points of a path for its signal, and in `layout.json`.
MIN_PATH_SAMPLES = 120

#: Largest difference of tangents from those that follow from the points, which files round.
_SMOOTH_TOLERANCE_MM = 1e-3
_UNIT_ROUNDING = 1e-15  # rounding error of a unit vector


def _dot(a: Float, b: Float) -> float:
    """Return the product of two vectors (3,), the same on every processor, unlike BLAS."""
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return float(a1 * b1 + a2 * b2 + a3 * b3)


def _normalize(vector: Float) -> Float:
    length = math.sqrt(_dot(vector, vector))
    return vector if abs(length - 1) <= _UNIT_ROUNDING else vector / length


@dataclass(frozen=True)
class Plane:
    """Frame of a cord's plane.

    Attributes:
        origin: Origin (3,), mm.
        axes: Orthonormal matrix (3, 3) whose columns are x, y and the normal.

    Raises:
        ValueError: A shape is wrong, or the axes are not orthonormal.
    """

    origin: Float
    axes: Float

    def __post_init__(self) -> None:
        if self.origin.shape != (3,) or self.axes.shape != (3, 3):
            raise ValueError("plane: origin must be (3,) and axes (3, 3)")
        if np.abs(self.axes.T @ self.axes - np.eye(3)).max() > 1e-9:
            raise ValueError("plane: axes must be orthonormal")

    @property
    def normal(self) -> Float:
        """Unit normal (3,)."""
        return self.axes[:, 2]

    @classmethod
    def from_normal(cls, origin: Float, normal: Float, x_axis: Float) -> Plane:
        """Create a plane from its normal and the direction of its x axis.

        A normal and an x axis that are already orthonormal are used unchanged, so that a plane
        created from its own axes is equal to the last digit.

        Args:
            origin: Origin (3,), mm.
            normal: Normal (3,) of any length.
            x_axis: Vector (3,) whose component in the plane gives the x axis.

        Returns:
            The plane.

        Raises:
            ValueError: The normal is zero, or parallel to `x_axis`.
        """
        normal, x_axis = np.asarray(normal, float), np.asarray(x_axis, float)
        if np.linalg.norm(normal) < 1e-9:
            raise ValueError("the normal must not be zero")
        n = _normalize(normal)
        x, height = x_axis, _dot(x_axis, n)
        if abs(height) > _UNIT_ROUNDING * np.linalg.norm(x_axis):
            x = x_axis - height * n
            x = x - _dot(x, n) * n  # remove the rounding error
        if np.linalg.norm(x) < 1e-9 * max(1.0, float(np.linalg.norm(x_axis))):
            raise ValueError("x_axis must not be parallel to the normal")
        x = _normalize(x)
        return cls(np.asarray(origin, float), np.stack([x, np.cross(n, x), n], axis=1))

    def coincides(self, other: Plane) -> bool:
        """Return whether both are the same plane, whatever their frames."""
        (a, b, c), (x, y, z) = self.normal.tolist(), other.normal.tolist()
        square = (b * z - c * y) ** 2 + (c * x - a * z) ** 2 + (a * y - b * x) ** 2
        return square < 1e-12 and abs(float((self.origin - other.origin) @ other.normal)) < 1e-4

    def to_world(self, points: Float) -> Float:
        """Transform points (..., 2) or (..., 3) in the plane's frame to the rest frame, mm."""
        return np.asarray(self.origin + self.turn(points))

    def turn(self, vectors: Float) -> Float:
        """Transform directions (..., 2) or (..., 3) in the plane's frame to the rest frame."""
        return np.asarray(vectors @ self.axes[:, : vectors.shape[-1]].T)


#: Frame of paths in space: their points are in the rest frame.
REST_FRAME = Plane(np.zeros(3), np.eye(3))


@dataclass(frozen=True)
class Hermite:
    """Piecewise cubic Hermite curve in a plane or in space.

    Span i covers t in [i, i + 1], from points[i] to points[i + 1], with the given derivatives by t.

    Attributes:
        points: Control points (k, 2) or (k, 3), k >= 2, mm.
        tangents: Derivatives (k, 2) or (k, 3) at the control points, mm.

    Raises:
        ValueError: A shape is wrong, or a number is not finite.
    """

    points: Float
    tangents: Float

    def __post_init__(self) -> None:
        shape = self.points.shape
        if len(shape) != 2 or shape[1] not in (2, 3) or shape[0] < 2:
            raise ValueError("a path needs at least two control points, each [x, y] or [x, y, z]")
        if self.tangents.shape != self.points.shape:
            raise ValueError("a path needs one tangent for each control point")
        if not (np.isfinite(self.points).all() and np.isfinite(self.tangents).all()):
            raise ValueError("control points and tangents must be finite numbers")

    @property
    def is_planar(self) -> bool:
        """Whether the curve is in a plane, with points [x, y]."""
        return bool(self.points.shape[1] == 2)

    def sample(self, per_span: int) -> Float:
        """Return the points ((k - 1) * per_span + 1, 2 or 3) at uniform t, mm."""
        basis = hermite_basis(len(self.points), per_span)[0]
        return np.asarray(basis @ np.concatenate([self.points, self.tangents]))


def catmull_rom(points: Float) -> Float:
    """Return tangents for a smooth curve through control points.

    They are central differences, one-sided at the ends. Where neighboring spans differ in length,
    they are weighted so that the curve does not overshoot in the shorter span (non-uniform
    Catmull-Rom, chordal, scaled to the shorter span).

    Args:
        points: Control points (..., k, 2) or (..., k, 3), mm.

    Returns:
        Tangents of the same shape, mm.
    """
    step = np.diff(points, axis=-2)
    length = np.maximum(np.linalg.norm(step, axis=-1, keepdims=True), 1e-12)
    out = np.empty_like(points)
    out[..., 0, :], out[..., -1, :] = step[..., 0, :], step[..., -1, :]
    a, b = length[..., :-1, :], length[..., 1:, :]
    slope = (step[..., :-1, :] / a * b + step[..., 1:, :] / b * a) / (a + b)
    out[..., 1:-1, :] = slope * np.minimum(a, b)
    return out


def is_smooth(curve: Hermite) -> bool:
    """Return whether the tangents of a curve follow from its points."""
    return np.allclose(curve.tangents, catmull_rom(curve.points), atol=_SMOOTH_TOLERANCE_MM)


@lru_cache(maxsize=64)
def hermite_basis(count: int, per_span: int) -> tuple[Float, Float, Float]:
    """Return the matrices that evaluate Hermite curves and their derivatives.

    Args:
        count: Number of control points k.
        per_span: Steps of t in each span.

    Returns:
        Three read-only matrices that map [points; tangents] (2k, 2 or 3). The first gives positions
        at ((k - 1) * per_span + 1) uniform t. The others give the first and second derivatives by t
        at both ends and at the inner t of every span, ((k - 1) * (per_span + 1)), since the
        curvature jumps at control points.
    """

    def rows(span: int, t: Float, order: int) -> Float:
        if order == 0:
            h = [2 * t**3 - 3 * t**2 + 1, -2 * t**3 + 3 * t**2, t**3 - 2 * t**2 + t, t**3 - t**2]
        elif order == 1:
            h = [6 * t**2 - 6 * t, -6 * t**2 + 6 * t, 3 * t**2 - 4 * t + 1, 3 * t**2 - 2 * t]
        else:
            h = [12 * t - 6, -12 * t + 6, 6 * t - 4, 6 * t - 2]
        out = np.zeros((len(t), 2 * count))
        out[:, span], out[:, span + 1] = h[0], h[1]
        out[:, count + span], out[:, count + span + 1] = h[2], h[3]
        return out

    t = np.linspace(0, 1, per_span + 1)
    spans = range(count - 1)
    position = np.concatenate([rows(i, t[:-1], 0) for i in spans] + [rows(count - 2, t[-1:], 0)])
    first, second = (np.concatenate([rows(i, t, k) for i in spans]) for k in (1, 2))
    for m in (position, first, second):
        m.flags.writeable = False
    return position, first, second


def curvature(points: Float, tangents: Float, per_span: int) -> Float:
    """Return the curvature of Hermite curves, with a sign in a plane.

    Args:
        points: Control points (..., k, 2) or (..., k, 3), mm.
        tangents: Tangents of the same shape, mm.
        per_span: Steps of the curve parameter in each span.

    Returns:
        Curvature (..., (k - 1) * (per_span + 1)) at both ends and inside of every span, 1/mm.
    """
    _, first, second = hermite_basis(points.shape[-2], per_span)
    stack = np.concatenate([points, tangents], axis=-2)
    d, dd = first @ stack, second @ stack
    speed = np.maximum(np.linalg.norm(d, axis=-1), 1e-12)
    if points.shape[-1] == 3:
        return np.asarray(np.linalg.norm(np.cross(d, dd), axis=-1) / speed**3)
    return np.asarray((d[..., 0] * dd[..., 1] - d[..., 1] * dd[..., 0]) / speed**3)


def bend_radius(points: Float) -> Float:
    """Return the radius of the circle through every three neighbors of a polyline.

    Args:
        points: Points (p, 3), mm.

    Returns:
        Radii (p - 2,), mm; 0 where the polyline turns back.
    """
    a, b, c = points[:-2], points[1:-1], points[2:]
    sides = [np.linalg.norm(x, axis=1) for x in (b - a, c - b, c - a)]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    radius = np.prod(sides, axis=0) / np.maximum(4 * area, 1e-12)
    turns_back = np.einsum("ij,ij->i", b - a, c - b) <= 0
    return np.asarray(np.where(turns_back, 0.0, radius))


def group_coincident_planes(planes: Sequence[Plane]) -> list[list[int]]:
    """Return the groups of coincident planes, as indices in the given order."""
    groups: list[list[int]] = []
    for i, plane in enumerate(planes):
        group = next((g for g in groups if plane.coincides(planes[g[0]])), None)
        if group is None:
            groups.append([i])
        else:
            group.append(i)
    return groups


def distinct_planes(planes: Sequence[Plane]) -> list[Plane]:
    """Return one plane of each coincident group: a body is cut once there."""
    return [planes[group[0]] for group in group_coincident_planes(planes)]


class FramedPath(Protocol):
    """Object with a curve in a frame, such as a sensor of a device."""

    @property
    def plane(self) -> Plane:
        """Plane of the path, or the frame of a path in space."""

    @property
    def curve(self) -> Hermite:
        """Curve in that plane or frame."""


def per_span_for_signal(curve: Hermite) -> int:
    """Return the points per span for at least `MIN_PATH_SAMPLES` points in all."""
    return int(np.ceil(MIN_PATH_SAMPLES / (len(curve.points) - 1)))


def per_span_for_spacing(curve: Hermite, spacing: float) -> int:
    """Return the points per span (32 to 2000) for neighbors at most about `spacing` mm apart."""
    coarse = curve.sample(16)
    longest = np.linalg.norm(np.diff(coarse, axis=0), axis=1).max() * 16
    return int(np.clip(longest / spacing, 32, 2000))


def per_span_for_sag(curve: Hermite, sag: float) -> int:
    """Return the points per span (8 to 400) for chords within `sag` mm of the curve."""
    second = hermite_basis(len(curve.points), 4)[2]
    bend = np.linalg.norm(second @ np.concatenate([curve.points, curve.tangents]), axis=1).max()
    return int(np.clip(np.ceil(np.sqrt(bend / (8 * sag))), 8, 400))


def sample_path(path: FramedPath, per_span: int | None = None) -> Float:
    """Return points along a path in the rest frame.

    Args:
        path: Object with a `plane` and a `curve`.
        per_span: Points per span; by default as many as for signals and `layout.json`.

    Returns:
        Points (p, 3), mm; p > `MIN_PATH_SAMPLES` by default.
    """
    count = per_span_for_signal(path.curve) if per_span is None else per_span
    return path.plane.to_world(path.curve.sample(count))


def arc_lengths(points: Float) -> Float:
    """Return the length (..., p) along polylines (..., p, d) from the first to each point, mm."""
    step = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*step.shape[:-1], 1)), np.cumsum(step, axis=-1)], axis=-1)


def resample(points: Float, start: float, end: float, count: int) -> Float:
    """Return points that are evenly spaced along a polyline.

    Args:
        points: Polyline (p, d), mm.
        start: Arc length of the first returned point from the polyline's first point, mm.
        end: Arc length of the last returned point, mm.
        count: Number of points.

    Returns:
        Points (count, d), mm.
    """
    along, lengths = arc_lengths(points), np.linspace(start, end, count)
    return np.stack([np.interp(lengths, along, column) for column in points.T], axis=1)
