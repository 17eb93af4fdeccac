"""Planes and planar piecewise-cubic Hermite curves, the shape of a cord's path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from .arrays import Float

# Points along the paths of cords: how many there are, and where along the length they lie.
#
# A path is a planar Hermite curve. Its points lie at a uniform curve parameter, the same number in
# every span, so that they depend linearly on control points and tangents: the optimiser's derivatives
# rest on that. How many are needed depends on the use: a number in all for signals, a spacing for
# distances, a sag for solids. What has to lie evenly along the length is resampled from them.

#: A path has at least this many points for its signal, and in `layout.json`.
SAMPLES = 120


class PlanarPath(Protocol):
    """What has a path: a curve in a plane, as a device's sensors are."""

    @property
    def plane(self) -> Plane: ...

    @property
    def curve(self) -> Hermite: ...


def per_span_for_signal(curve: Hermite) -> int:
    """Points of each span, for at least `SAMPLES` in all."""
    return int(np.ceil(SAMPLES / (len(curve.points) - 1)))


def per_span_for_spacing(curve: Hermite, spacing: float) -> int:
    """Points of each span, 32 to 2000, for neighbours at most about `spacing` mm apart."""
    coarse = curve.sample(16)
    longest = np.linalg.norm(np.diff(coarse, axis=0), axis=1).max() * 16
    return int(np.clip(longest / spacing, 32, 2000))


def per_span_for_sag(curve: Hermite, sag: float) -> int:
    """Points of each span, 8 to 400, for chords that lie within `sag` mm of the curve."""
    second = hermite_basis(len(curve.points), 4)[2]
    bend = np.linalg.norm(second @ np.concatenate([curve.points, curve.tangents]), axis=1).max()
    return int(np.clip(np.ceil(np.sqrt(bend / (8 * sag))), 8, 400))


def sample_path(path: PlanarPath, per_span: int | None = None) -> Float:
    """The path's points (p, 3) mm in the rest frame, `per_span` of each span of the curve; by
    default those of its signal and of `layout.json`, p > 100."""
    count = per_span_for_signal(path.curve) if per_span is None else per_span
    return path.plane.to_world(path.curve.sample(count))


def arc_lengths(points: Float) -> Float:
    """Length along polylines (..., p, d) from their first point to each point: (..., p), mm."""
    step = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*step.shape[:-1], 1)), np.cumsum(step, axis=-1)], axis=-1)


def resample(points: Float, start: float, end: float, count: int) -> Float:
    """`count` points (count, d) of a polyline (p, d), evenly along its length between the arc
    lengths `start` and `end` mm from its first point."""
    along, at = arc_lengths(points), np.linspace(start, end, count)
    return np.stack([np.interp(at, along, column) for column in points.T], axis=1)


_EXACT = 1e-15  # of a unit vector: what rounding leaves


def _dot(a: Float, b: Float) -> float:
    """Of two vectors (3,), the same on every processor, which BLAS is not."""
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return float(a1 * b1 + a2 * b2 + a3 * b3)


def _unit(vector: Float) -> Float:
    length = math.sqrt(_dot(vector, vector))
    return vector if abs(length - 1) <= _EXACT else vector / length


@dataclass(frozen=True)
class Plane:
    """Frame of a cord plane: `origin` (3,) mm; columns of `axes` (3, 3): x, y, normal."""

    origin: Float
    axes: Float

    def __post_init__(self) -> None:
        if self.origin.shape != (3,) or self.axes.shape != (3, 3):
            raise ValueError("plane: origin must be (3,) and axes (3, 3)")
        if np.abs(self.axes.T @ self.axes - np.eye(3)).max() > 1e-9:
            raise ValueError("plane: axes must be orthonormal")

    @property
    def normal(self) -> Float:
        return self.axes[:, 2]

    @classmethod
    def from_normal(cls, origin: Float, normal: Float, x_axis: Float) -> Plane:
        """Frame with the given normal and the part of `x_axis` that lies in the plane.

        A normal and an x axis that are orthonormal already are taken as they are, so that a frame
        made from its own axes is itself to the last digit.
        """
        normal, x_axis = np.asarray(normal, float), np.asarray(x_axis, float)
        if np.linalg.norm(normal) < 1e-9:
            raise ValueError("the normal must not be zero")
        n = _unit(normal)
        x, off = x_axis, _dot(x_axis, n)
        if abs(off) > _EXACT * np.linalg.norm(x_axis):
            x = x_axis - off * n
            x = x - _dot(x, n) * n  # what rounding has left
        if np.linalg.norm(x) < 1e-9 * max(1.0, float(np.linalg.norm(x_axis))):
            raise ValueError("x_axis must not be parallel to the normal")
        x = _unit(x)
        return cls(np.asarray(origin, float), np.stack([x, np.cross(n, x), n], axis=1))

    def coincides(self, other: Plane) -> bool:
        """Whether both are the same plane, whatever their frames."""
        (a, b, c), (x, y, z) = self.normal.tolist(), other.normal.tolist()
        square = (b * z - c * y) ** 2 + (c * x - a * z) ** 2 + (a * y - b * x) ** 2
        return square < 1e-12 and abs(float((self.origin - other.origin) @ other.normal)) < 1e-4

    def to_world(self, points: Float) -> Float:
        """In-plane points (..., 2) to the rest frame (..., 3), mm."""
        return np.asarray(self.origin + points @ self.axes[:, :2].T)


@dataclass(frozen=True)
class Hermite:
    """Piecewise cubic Hermite curve: `points` (k, 2) and `tangents` (k, 2), k >= 2, in mm.

    Span i runs over t in [i, i + 1] from points[i] to points[i + 1] with the given
    derivatives with respect to t.
    """

    points: Float
    tangents: Float

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 2 or len(self.points) < 2:
            raise ValueError("a path needs at least two control points, each [x, y]")
        if self.tangents.shape != self.points.shape:
            raise ValueError("a path needs one tangent for each control point")
        if not (np.isfinite(self.points).all() and np.isfinite(self.tangents).all()):
            raise ValueError("control points and tangents must be finite numbers")

    def sample(self, per_span: int) -> Float:
        """Points at uniform t, ((k - 1) * per_span + 1, 2)."""
        basis = hermite_basis(len(self.points), per_span)[0]
        return np.asarray(basis @ np.concatenate([self.points, self.tangents]))


def catmull_rom(points: Float) -> Float:
    """Central differences through `points` (..., k, 2), one-sided at the ends: (..., k, 2).

    Where neighbouring spans differ in length the tangent is weighted so that the curve keeps
    the shorter span free of overshoot (non-uniform Catmull-Rom, chordal, scaled to the
    shorter span).
    """
    step = np.diff(points, axis=-2)
    length = np.maximum(np.linalg.norm(step, axis=-1, keepdims=True), 1e-12)
    out = np.empty_like(points)
    out[..., 0, :], out[..., -1, :] = step[..., 0, :], step[..., -1, :]
    a, b = length[..., :-1, :], length[..., 1:, :]
    slope = (step[..., :-1, :] / a * b + step[..., 1:, :] / b * a) / (a + b)
    out[..., 1:-1, :] = slope * np.minimum(a, b)
    return out


@lru_cache(maxsize=64)
def hermite_basis(count: int, per_span: int) -> tuple[Float, Float, Float]:
    """Matrices that map [points; tangents] (2k, 2) to positions, first and second derivatives.

    The positions are at ((k - 1) * per_span + 1) uniform t. The derivatives are at both ends
    and at interior t of every span, ((k - 1) * (per_span + 1)), since the curvature jumps at
    control points.
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
    """Signed curvature (..., q) in 1/mm of Hermite curves given by `points` and `tangents`
    (..., k, 2), at both ends and inside of every span."""
    _, first, second = hermite_basis(points.shape[-2], per_span)
    stack = np.concatenate([points, tangents], axis=-2)
    d, dd = first @ stack, second @ stack
    speed = np.maximum(np.linalg.norm(d, axis=-1), 1e-12)
    return np.asarray((d[..., 0] * dd[..., 1] - d[..., 1] * dd[..., 0]) / speed**3)


def bend_radius(points: Float) -> Float:
    """Radius of the circle through each three neighbours, (p - 2,) mm."""
    a, b, c = points[:-2], points[1:-1], points[2:]
    sides = [np.linalg.norm(x, axis=1) for x in (b - a, c - b, c - a)]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    radius = np.prod(sides, axis=0) / np.maximum(4 * area, 1e-12)
    turned_back = np.einsum("ij,ij->i", b - a, c - b) <= 0
    return np.asarray(np.where(turned_back, 0.0, radius))


def coincident(planes: Sequence[Plane]) -> list[list[int]]:
    """Sets of coincident planes, as their indices."""
    out: list[list[int]] = []
    for i, p in enumerate(planes):
        same = next((known for known in out if p.coincides(planes[known[0]])), None)
        if same is None:
            out.append([i])
        else:
            same.append(i)
    return out


def distinct(planes: Sequence[Plane]) -> list[Plane]:
    """One of each set of coincident planes: a body is cut there once."""
    return [planes[same[0]] for same in coincident(planes)]
