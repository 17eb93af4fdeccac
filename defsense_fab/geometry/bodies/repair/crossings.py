"""Find triangles at which a surface passes through itself or does not separate inside from
outside.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.machine.compiled import compiled
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
    pairs = _pairs(
        points,
        np.ascontiguousarray(faces, np.int64)[at],
        boxes,
        leaves,
        VOLUME_TOLERANCE * size**3,
        min(MAX_PAIRS, 8 * len(faces)),
    )
    return np.asarray(at[pairs])


def _morton_codes(points: Float) -> Int:
    """Return positions along a curve that keeps neighbors together."""
    low, extent = points.min(0), np.maximum(np.ptp(points, axis=0), 1e-300)
    cells = np.minimum((points - low) / extent * 1024, 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


@compiled()
def _pairs(v: Float, f: Int, boxes: Float, leaves: int, tolerance: float, max_pairs: int) -> Any:
    pairs = np.empty((max_pairs, 2), np.int64)
    count = 0
    stack = np.empty(128, np.int64)
    for i in range(len(f)):
        lx = min(v[f[i, 0], 0], v[f[i, 1], 0], v[f[i, 2], 0])
        ly = min(v[f[i, 0], 1], v[f[i, 1], 1], v[f[i, 2], 1])
        lz = min(v[f[i, 0], 2], v[f[i, 1], 2], v[f[i, 2], 2])
        hx = max(v[f[i, 0], 0], v[f[i, 1], 0], v[f[i, 2], 0])
        hy = max(v[f[i, 0], 1], v[f[i, 1], 1], v[f[i, 2], 1])
        hz = max(v[f[i, 0], 2], v[f[i, 1], 2], v[f[i, 2], 2])
        stack[0] = 1
        top = 1
        while top:
            top -= 1
            node = stack[top]
            b = boxes[node]
            if b[0] > hx or b[3] < lx or b[1] > hy or b[4] < ly or b[2] > hz or b[5] < lz:
                continue
            if node < leaves:
                stack[top] = 2 * node
                stack[top + 1] = 2 * node + 1
                top += 2
                continue
            first = (node - leaves) * TRIANGLES_PER_LEAF
            for j in range(max(first, i + 1), min(first + TRIANGLES_PER_LEAF, len(f))):
                if _cross(v, f[i], f[j], tolerance):
                    if count == len(pairs):
                        return pairs
                    pairs[count, 0], pairs[count, 1] = i, j
                    count += 1
    return pairs[:count]


@compiled()
def _cross(v: Float, p: Int, q: Int, tolerance: float) -> bool:
    """Whether an edge of one triangle goes through the other; edges at a shared corner cannot."""
    for k in range(3):
        a, b, c = v[p[0], k], v[p[1], k], v[p[2], k]
        d, e, f = v[q[0], k], v[q[1], k], v[q[2], k]
        if min(a, b, c) > max(d, e, f) or max(a, b, c) < min(d, e, f):
            return False
    shared = 0
    for i in range(3):
        for j in range(3):
            shared += p[i] == q[j]
    if shared > 1:
        return False
    for k in range(3):
        if _edge_pierces(v, p[k], p[(k + 1) % 3], q, tolerance):
            return True
        if _edge_pierces(v, q[k], q[(k + 1) % 3], p, tolerance):
            return True
    return False


@compiled()
def _edge_pierces(v: Float, s: int, e: int, q: Int, tolerance: float) -> bool:
    for i in range(3):
        if s == q[i] or e == q[i]:
            return False
    return bool(_pierces(v[s], v[e], v[q[0]], v[q[1]], v[q[2]], tolerance))


@compiled()
def _pierces(s: Float, e: Float, a: Float, b: Float, c: Float, tolerance: float) -> Any:
    """Whether the segment from s to e goes through the inside of the triangle a, b, c."""
    above, below = _volume(a, b, c, s), _volume(a, b, c, e)
    if not (
        (above > tolerance and below < -tolerance) or (above < -tolerance and below > tolerance)
    ):
        return False
    x, y, z = _volume(s, e, a, b), _volume(s, e, b, c), _volume(s, e, c, a)
    return (x > tolerance and y > tolerance and z > tolerance) or (
        x < -tolerance and y < -tolerance and z < -tolerance
    )


@compiled()
def _volume(a: Float, b: Float, c: Float, d: Float) -> Any:
    """Return six times the signed volume of a tetrahedron."""
    x, y, z = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    p, q, r = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    s, t, u = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return x * (q * u - r * t) + y * (r * s - p * u) + z * (p * t - q * s)
