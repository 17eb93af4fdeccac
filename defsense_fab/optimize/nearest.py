"""Closest points between polylines: the inner loop of clearances."""

from __future__ import annotations

import numba
import numpy as np

from ..core.arrays import Float, Int


def nearest(points: Float, line: Float) -> tuple[Float, Int, Float]:
    """Distance (p,) of points (p, 3) from a polyline (q, 3), the segment (p,) where it is
    attained, and where on that segment (p,), 0 to 1."""
    none = np.zeros(0)
    return _nearest(points, line, none, none, 0.0)  # type: ignore[no-any-return]


def nearest_strand(path: Float, apart: float) -> tuple[Float, Int, Float]:
    """Like `nearest` for a path (p, 3) and itself, where segments less than `apart` mm further
    along do not count; the distance is inf where none is left."""
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.concatenate([[0], np.cumsum(step)])
    middle = (along[1:] + along[:-1]) / 2
    return _nearest(path, path, along, middle, apart + step.max())  # type: ignore[no-any-return]


def gaps(paths: Float, line: Float) -> Float:
    """Least distance (c,) of the points of each path (c, p, 3) from a polyline (q, 3)."""
    distance = nearest(paths.reshape(-1, 3), line)[0].reshape(paths.shape[:2])
    return np.asarray(distance.min(axis=1))


@numba.njit(cache=True)
def _nearest(points, line, along, middle, apart):  # type: ignore[no-untyped-def]
    distance = np.full(len(points), np.inf)
    segment = np.zeros(len(points), np.int64)
    where = np.zeros(len(points))
    for p in range(len(points)):
        for k in range(len(line) - 1):
            if apart > 0.0 and abs(along[p] - middle[k]) < apart:
                continue
            dot, size = 0.0, 0.0
            for d in range(3):
                step = line[k + 1, d] - line[k, d]
                dot += (points[p, d] - line[k, d]) * step
                size += step * step
            t = min(max(dot / max(size, 1e-30), 0.0), 1.0)
            square = 0.0
            for d in range(3):
                gap = points[p, d] - line[k, d] - t * (line[k + 1, d] - line[k, d])
                square += gap * gap
            if square < distance[p]:
                distance[p], segment[p], where[p] = square, k, t
        distance[p] = np.sqrt(distance[p])
    return distance, segment, where
