"""Find closest points of polylines: the inner loop of clearances."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import arc_lengths
from ...core.machine import kernels


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
    return _nearest(points, line, empty, empty, 0.0)


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
    return _nearest(path, path, along, middle, separation + float(longest))


def path_gaps(paths: Float, line: Float) -> Float:
    """Return the smallest distance (c,) of each path's points (c, p, 3) from a polyline (q, 3)."""
    distance = nearest_on_polyline(paths.reshape(-1, 3), line)[0].reshape(paths.shape[:2])
    return np.asarray(distance.min(axis=1))


def self_gaps(paths: Float, separation: float) -> Float:
    """Return the smallest distance (c,) of each path (c, p, 3) from its own other strands.

    As in `nearest_on_strand`, but between points; infinite for paths without another strand.
    """
    out = np.empty(len(paths))
    kernels.self_gaps(np.ascontiguousarray(paths), separation, out)
    return out


def _nearest(
    points: Float, line: Float, along: Float, middle: Float, separation: float
) -> tuple[Float, Int, Float]:
    count = len(points)
    distance, segment, where = np.empty(count), np.empty(count, np.int64), np.empty(count)
    kernels.nearest_segments(
        np.ascontiguousarray(points), np.ascontiguousarray(line), along, middle, separation,
        distance, segment, where,
    )  # fmt: skip
    return distance, segment, where
