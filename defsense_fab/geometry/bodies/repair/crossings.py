"""Find triangles at which a surface passes through itself or does not separate inside from
outside.
"""

from __future__ import annotations

import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.machine import kernels
from ....core.mesh import Surface
from ...kernels.surface_queries import SignedDistance

STEP_SHARE = 1e-5  # of the bounding box's diagonal
MIN_HEIGHT_SHARE = 1e-4  # of the diagonal; thinner triangles may be narrower than the step


def winding_on_both_sides(
    surface: Surface, points: Float, normals: Float, size: float
) -> tuple[Float, Float]:
    """Return the winding numbers (n,) just behind and just in front of a surface.

    Args:
        surface: The surface.
        points: Points (n, 3) on the surface, mm.
        normals: Unit normals (n, 3) there.
        size: Diagonal of the bounding box, mm.
    """
    step, distances = STEP_SHARE * size * normals, SignedDistance(surface)
    return distances.winding(points - step), distances.winding(points + step)


def find_wrong_faces(surface: Surface, size: float) -> Bool:
    """Return triangles (m,) that do not have the inside behind them and the outside in front of
    them.

    The winding number must be 1 behind and 0 in front. Triangles that are too thin to judge are not
    reported.
    """
    a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    longest = np.maximum.reduce([np.linalg.norm(x, axis=1) for x in (b - a, c - b, a - c)])
    is_thick = length > MIN_HEIGHT_SHARE * size * longest
    wrong = np.zeros(len(normal), bool)
    behind, before = winding_on_both_sides(
        surface,
        ((a + b + c) / 3)[is_thick],
        normal[is_thick] / length[is_thick, None],
        size,
    )
    wrong[is_thick] = (np.abs(behind - 1) > 0.5) | (np.abs(before) > 0.5)
    return wrong


TRIANGLES_PER_LEAF = 4
MAX_PAIRS = 1_000_000  # of crossing triangles that are searched for
VOLUME_TOLERANCE = 1e-15  # of the cube of the surface's size: smaller volumes are rounding


def find_crossing_pairs(vertices: Float, faces: Int) -> Int:
    """Return pairs of triangles of which an edge of one goes through the other.

    Triangles that touch, lie in one plane or share an edge do not count.

    Args:
        vertices: Corners (n, 3), mm.
        faces: Triangles (m, 3).

    Returns:
        Indices (k, 2) of triangles; at most a million pairs.
    """
    if len(faces) < 2:
        return np.zeros((0, 2), np.int64)
    middle = (vertices.min(0) + vertices.max(0)) / 2
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    points = np.ascontiguousarray(vertices - middle)
    corners = points[faces]
    low, high = corners.min(1), corners.max(1)
    order = np.argsort(_morton_codes((low + high) / 2), kind="stable")
    leaves = 1
    while leaves * TRIANGLES_PER_LEAF < len(faces):
        leaves *= 2
    boxes = np.empty((2 * leaves, 6))
    boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
    count = -(-len(faces) // TRIANGLES_PER_LEAF)
    starts = np.arange(count) * TRIANGLES_PER_LEAF
    boxes[leaves : leaves + count, :3] = np.minimum.reduceat(low[order], starts)
    boxes[leaves : leaves + count, 3:] = np.maximum.reduceat(high[order], starts)
    level = leaves
    while level > 1:  # the children of node i are 2 i and 2 i + 1
        children = boxes[level : 2 * level].reshape(-1, 2, 6)
        boxes[level // 2 : level, :3] = children[:, :, :3].min(1)
        boxes[level // 2 : level, 3:] = children[:, :, 3:].max(1)
        level //= 2
    at = order.astype(np.int64)
    pairs, found = np.empty((min(MAX_PAIRS, 8 * len(faces)), 2), np.int64), np.empty(1, np.int64)
    ordered, tolerance = np.ascontiguousarray(faces, np.int64)[at], VOLUME_TOLERANCE * size**3
    kernels.crossing_pairs(points, ordered, boxes, TRIANGLES_PER_LEAF, tolerance, pairs, found)
    return np.asarray(at[pairs[: found[0]]])


def _morton_codes(points: Float) -> Int:
    """Return positions along a curve that keeps neighbors together."""
    low, extent = points.min(0), np.maximum(np.ptp(points, axis=0), 1e-300)
    cells = np.minimum((points - low) / extent * 1024, 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code
