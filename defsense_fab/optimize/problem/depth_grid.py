"""Depth below the body's surface on a grid, for the many points of candidates."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import ndimage

from ...core.arrays import Float
from ...core.machine.compiled import compiled
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import signed_distance_of

#: Nodes of the grid, and its finest spacing, mm.
_MAX_NODES, _MIN_SPACING_MM = 60_000, 1.0
_CHUNK_NODES = 250  # nodes at once


class DepthGrid:
    """Depth interpolated on a grid; negative everywhere outside of it."""

    def __init__(self, surface: Surface) -> None:
        low, high = surface.bounds
        self.spacing = max(float(np.cbrt(np.prod(high - low) / _MAX_NODES)), _MIN_SPACING_MM)
        count = np.ceil((high - low) / self.spacing).astype(int) + 3
        self.origin = (low + high) / 2 - self.spacing * (count - 1) / 2
        ticks = [a + self.spacing * np.arange(n) for a, n in zip(self.origin, count, strict=True)]
        nodes = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
        exact = signed_distance_of(surface)
        distance = _evaluate_in_chunks(exact.unsigned, nodes.reshape(-1, 3)).reshape(count)
        # Between neighbours that are both more than half a step away there is no surface: one
        # of all that hang together tells for the others.
        same, kinds = ndimage.label(distance > 0.51 * self.spacing)
        first = np.unique(same, return_index=True)[1] if kinds else np.zeros(0, int)
        asked = np.union1d(np.flatnonzero(same == 0), first)
        inside = np.zeros(same.size, bool)
        inside[asked] = _evaluate_in_chunks(exact.inside, nodes.reshape(-1, 3)[asked])
        of_kind = np.zeros(kinds + 1, bool)
        of_kind[same.ravel()[first]] = inside[first]
        inside = np.where(same.ravel() > 0, of_kind[same.ravel()], inside).reshape(count)
        self.depths = np.where(inside, distance, -distance)

    @property
    def error(self) -> float:
        """How wrong it is beside an edge of the body, about, mm."""
        return self.spacing / 4

    def __call__(self, points: Float) -> Float:
        """Depth (...,) mm at points (..., 3)."""
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        found = _interpolate(self.depths, self.origin, self.spacing, flat)
        return np.asarray(found.reshape(points.shape[:-1]))

    def exits(self, points: Float, directions: Float, longest: float) -> Float:
        """How far (c,) mm the rays from points (c, 3) inside along unit directions (c, 3) run
        before they leave the body; inf where that is more than `longest` mm."""
        return np.asarray(
            _exits(
                self.depths,
                self.origin,
                self.spacing,
                np.ascontiguousarray(points),
                np.ascontiguousarray(directions),
                float(longest),
            )
        )


def _evaluate_in_chunks(told: Callable[[Float], Any], points: Float) -> Any:
    """What is told of points (p, 3), some at a time: libigl holds the interpreter, and other
    threads would wait for all of it."""
    return np.concatenate(
        [told(points[k : k + _CHUNK_NODES]) for k in range(0, len(points), _CHUNK_NODES)]
    )


@compiled()
def _depth_at(depth, low, step, x, y, z):  # type: ignore[no-untyped-def]
    a, b, c = (x - low[0]) / step, (y - low[1]) / step, (z - low[2]) / step
    n0, n1, n2 = depth.shape
    if a < 0 or b < 0 or c < 0 or a >= n0 - 1 or b >= n1 - 1 or c >= n2 - 1:
        return -step
    i, j, k = int(a), int(b), int(c)
    a, b, c = a - i, b - j, c - k
    out = 0.0
    for s in range(2):
        for t in range(2):
            w = (a if s else 1 - a) * (b if t else 1 - b)
            out += w * ((1 - c) * depth[i + s, j + t, k] + c * depth[i + s, j + t, k + 1])
    return out


@compiled()
def _interpolate(depth, low, step, points):  # type: ignore[no-untyped-def]
    out = np.empty(len(points))
    for p in range(len(points)):
        out[p] = _depth_at(depth, low, step, points[p, 0], points[p, 1], points[p, 2])
    return out


@compiled()
def _exits(depth, low, step, points, directions, longest):  # type: ignore[no-untyped-def]
    out = np.full(len(points), np.inf)
    stride = step / 2
    for c in range(len(points)):
        p, d = points[c], directions[c]
        before, s = _depth_at(depth, low, step, p[0], p[1], p[2]), 0.0
        while s < longest:
            s += stride
            now = _depth_at(depth, low, step, p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2])
            if now <= 0:
                out[c] = max(s - stride * (1 - before / (before - now)), 0.0) if before > 0 else 0.0
                break
            before = now
    return out
