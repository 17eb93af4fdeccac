"""Closest points between polylines: the inner loop of clearances."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import arc_lengths
from ...core.machine.compiled import compiled


def nearest_on_polyline(points: Float, line: Float) -> tuple[Float, Int, Float]:
    """Distance (p,) of points (p, 3) from a polyline (q, 3), the segment (p,) where it is
    attained, and where on that segment (p,), 0 to 1."""
    none = np.zeros(0)
    return _nearest(points, line, none, none, 0.0)  # type: ignore[no-any-return]


def nearest_on_strand(path: Float, apart: float) -> tuple[Float, Int, Float]:
    """Like `nearest` for a path (p, 3) and itself, where segments less than `apart` mm further
    along do not count; the distance is inf where none is left."""
    along = arc_lengths(path)
    middle, longest = (along[1:] + along[:-1]) / 2, np.diff(along).max()
    return _nearest(path, path, along, middle, apart + longest)  # type: ignore[no-any-return]


def path_gaps(paths: Float, line: Float) -> Float:
    """Least distance (c,) of the points of each path (c, p, 3) from a polyline (q, 3)."""
    distance = nearest_on_polyline(paths.reshape(-1, 3), line)[0].reshape(paths.shape[:2])
    return np.asarray(distance.min(axis=1))


@compiled()
def self_gaps(paths, apart):  # type: ignore[no-untyped-def]
    """Least distance (c,) of each path (c, p, 3) from itself as in `nearest_strand`, between its
    points; inf where none are far enough along."""
    out = np.full(len(paths), np.inf)
    count = paths.shape[1]
    along = np.zeros(count)
    for c in range(len(paths)):
        longest = 0.0
        for p in range(1, count):
            step = 0.0
            for d in range(3):
                step += (paths[c, p, d] - paths[c, p - 1, d]) ** 2
            step = np.sqrt(step)
            longest = max(longest, step)
            along[p] = along[p - 1] + step
        for p in range(count):
            for q in range(p):
                if along[p] - along[q] >= apart + longest:
                    square = 0.0
                    for d in range(3):
                        square += (paths[c, p, d] - paths[c, q, d]) ** 2
                    out[c] = min(out[c], square)
        out[c] = np.sqrt(out[c])
    return out


@compiled()
def _nearest(points, line, along, middle, apart):  # type: ignore[no-untyped-def]
    count = len(line) - 1
    distance = np.full(len(points), np.inf)
    segment = np.zeros(len(points), np.int64)
    where = np.zeros(len(points))
    longest = 0.0
    for k in range(count):
        longest = max(longest, np.sqrt(((line[k + 1] - line[k]) ** 2).sum()))
    for p in range(len(points)):
        start = segment[p - 1] if p > 0 else 0  # neighbours are near to neighbouring segments
        for turn in range(count + 1):
            k = start if turn == 0 else turn - 1
            if apart > 0.0 and abs(along[p] - middle[k]) < apart:
                continue
            dot, size, gap = 0.0, 0.0, 0.0
            for d in range(3):
                step = line[k + 1, d] - line[k, d]
                off = points[p, d] - line[k, d]
                dot += off * step
                size += step * step
                gap += off * off
            if gap > (distance[p] + longest) ** 2:
                continue
            t = min(max(dot / max(size, 1e-30), 0.0), 1.0)
            square = gap - 2 * t * dot + t * t * size
            if square < distance[p] ** 2:
                distance[p], segment[p], where[p] = np.sqrt(max(square, 0.0)), k, t
    return distance, segment, where
