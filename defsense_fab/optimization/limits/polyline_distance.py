"""Find closest points of polylines: the inner loop of clearances."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import arc_lengths
from ...core.machine.compiled import compiled


def nearest_on_polyline(points: Float, line: Float) -> tuple[Float, Int, Float]:
    """Find the closest points of a polyline.

    Args:
        points: Points (p, 3) mm.
        line: Polyline (q, 3) mm.

    Returns:
        Distances (p,) mm, numbers (p,) of the closest segments, and positions (p,) on these
        segments, 0 to 1.
    """
    empty = np.zeros(0)
    return _nearest(points, line, empty, empty, 0.0)  # type: ignore[no-any-return]


def nearest_on_strand(path: Float, separation: float) -> tuple[Float, Int, Float]:
    """Find the closest points of a path on its own other strands.

    Args:
        path: Path (p, 3) mm.
        separation: Length along the path, mm; nearer segments do not count.

    Returns:
        As `nearest_on_polyline`; the distance is infinite for points without another strand.
    """
    along = arc_lengths(path)
    middle, longest = (along[1:] + along[:-1]) / 2, np.diff(along).max()
    return _nearest(path, path, along, middle, separation + longest)  # type: ignore[no-any-return]


def path_gaps(paths: Float, line: Float) -> Float:
    """Return the smallest distance (c,) of each path's points (c, p, 3) from a polyline (q, 3)."""
    distance = nearest_on_polyline(paths.reshape(-1, 3), line)[0].reshape(paths.shape[:2])
    return np.asarray(distance.min(axis=1))


@compiled()
def self_gaps(paths, separation):  # type: ignore[no-untyped-def]
    """Return the smallest distance (c,) of each path (c, p, 3) from its own other strands.

    As in `nearest_on_strand`, but between points; infinite for paths without another strand.
    """
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
                if along[p] - along[q] >= separation + longest:
                    square = 0.0
                    for d in range(3):
                        square += (paths[c, p, d] - paths[c, q, d]) ** 2
                    out[c] = min(out[c], square)
        out[c] = np.sqrt(out[c])
    return out


@compiled()
def _nearest(points, line, along, middle, separation):  # type: ignore[no-untyped-def]
    count = len(line) - 1
    distance = np.full(len(points), np.inf)
    segment = np.zeros(len(points), np.int64)
    where = np.zeros(len(points))
    longest = 0.0
    for k in range(count):
        longest = max(longest, np.sqrt(((line[k + 1] - line[k]) ** 2).sum()))
    for p in range(len(points)):
        start = (
            segment[p - 1] if p > 0 else 0
        )  # neighboring points are close to neighboring segments
        for turn in range(count + 1):
            k = start if turn == 0 else turn - 1
            if separation > 0.0 and abs(along[p] - middle[k]) < separation:
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
