"""Where a surface passes through itself: pairs of its triangles that cross."""

from __future__ import annotations

from typing import Any

import igl
import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.machine.compiled import compiled

# What a surface encloses, by its winding number; the last word on whether it is sound.

_STEP_OFF = 1e-5  # of the bounding box's diagonal
_HEIGHT = 1e-4  # likewise: thinner triangles may be steps no wider than what is stepped off


class Inside:
    """Of triangles that need be neither closed nor apart from each other: what the generalised
    winding number (Jacobson et al. 2013; Barill et al. 2018) says is in."""

    def __init__(self, vertices: Float, faces: Int) -> None:
        self._tree = igl.FastWindingNumberBVH()
        self._tree.init(np.ascontiguousarray(vertices), np.ascontiguousarray(faces))

    def number(self, points: Float) -> Float:
        """The winding number at points (n, 3)."""
        return np.asarray(self._tree.winding_number(np.ascontiguousarray(points)))

    def __call__(self, points: Float) -> Bool:
        """Whether points (n, 3) are in."""
        return np.asarray(self.number(points) > 0.5)


def beside(inside: Inside, points: Float, normals: Float, size: float) -> tuple[Float, Float]:
    """The winding numbers (n,) just behind and just before a surface with normals (n, 3) at its
    points (n, 3)."""
    step = _STEP_OFF * size * normals
    return inside.number(points - step), inside.number(points + step)


def wrong_faces(vertices: Float, faces: Int, size: float) -> Bool:
    """Triangles (m,) that do not have the inside behind them, with a winding number of 1, and the
    outside before them, with 0. Of those that are too thin to
    tell, none is wrong."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    longest = np.maximum.reduce([np.linalg.norm(x, axis=1) for x in (b - a, c - b, a - c)])
    whole = length > _HEIGHT * size * longest
    wrong = np.zeros(len(faces), bool)
    behind, before = beside(
        Inside(vertices, faces),
        ((a + b + c) / 3)[whole],
        normal[whole] / length[whole, None],
        size,
    )
    wrong[whole] = (np.abs(behind - 1) > 0.5) | (np.abs(before) > 0.5)
    return wrong


_LEAF = 4  # triangles
_MOST = 1_000_000  # pairs that are looked for
_NOTHING = 1e-15  # of the cube of the surface's size: a volume that rounding gives


def crossing_pairs(vertices: Float, faces: Int) -> Int:
    """Pairs (k, 2) of the triangles (m, 3) of which an edge of one goes through the other.

    Triangles that touch, lie in one plane or share an edge do not count.
    """
    if len(faces) < 2:
        return np.zeros((0, 2), np.int64)
    middle = (vertices.min(0) + vertices.max(0)) / 2
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    points = np.ascontiguousarray(vertices - middle)
    corners = points[faces]
    low, high = corners.min(1), corners.max(1)
    order = np.argsort(_morton((low + high) / 2), kind="stable")
    leaves = 1
    while leaves * _LEAF < len(faces):
        leaves *= 2
    boxes = np.empty((2 * leaves, 6))
    boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
    count = -(-len(faces) // _LEAF)
    starts = np.arange(count) * _LEAF
    boxes[leaves : leaves + count, :3] = np.minimum.reduceat(low[order], starts)
    boxes[leaves : leaves + count, 3:] = np.maximum.reduceat(high[order], starts)
    level = leaves
    while level > 1:  # the children of node i are 2 i and 2 i + 1
        children = boxes[level : 2 * level].reshape(-1, 2, 6)
        boxes[level // 2 : level, :3] = children[:, :, :3].min(1)
        boxes[level // 2 : level, 3:] = children[:, :, 3:].max(1)
        level //= 2
    at = order.astype(np.int64)
    found = _pairs(points, np.ascontiguousarray(faces, np.int64)[at], boxes, leaves,
                   _NOTHING * size**3, min(_MOST, 8 * len(faces)))  # fmt: skip
    return np.asarray(at[found])


def _morton(points: Float) -> Int:
    """Places along a curve that keeps neighbours together."""
    low, extent = points.min(0), np.maximum(np.ptp(points, axis=0), 1e-300)
    cells = np.minimum((points - low) / extent * 1024, 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


@compiled()
def _pairs(v: Float, f: Int, boxes: Float, leaves: int, nothing: float, most: int) -> Any:
    found = np.empty((most, 2), np.int64)
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
            first = (node - leaves) * 4
            for j in range(max(first, i + 1), min(first + 4, len(f))):
                if _cross(v, f[i], f[j], nothing):
                    if count == len(found):
                        return found
                    found[count, 0], found[count, 1] = i, j
                    count += 1
    return found[:count]


@compiled()
def _cross(v: Float, p: Int, q: Int, nothing: float) -> bool:
    """Whether an edge of one triangle goes through the other; edges at a corner that both have
    cannot."""
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
        if _edge_pierces(v, p[k], p[(k + 1) % 3], q, nothing):
            return True
        if _edge_pierces(v, q[k], q[(k + 1) % 3], p, nothing):
            return True
    return False


@compiled()
def _edge_pierces(v: Float, s: int, e: int, q: Int, nothing: float) -> bool:
    for i in range(3):
        if s == q[i] or e == q[i]:
            return False
    return bool(_pierces(v[s], v[e], v[q[0]], v[q[1]], v[q[2]], nothing))


@compiled()
def _pierces(s: Float, e: Float, a: Float, b: Float, c: Float, nothing: float) -> Any:
    """Whether the segment from s to e goes through the inside of the triangle a, b, c."""
    above, below = _volume(a, b, c, s), _volume(a, b, c, e)
    if not ((above > nothing and below < -nothing) or (above < -nothing and below > nothing)):
        return False
    x, y, z = _volume(s, e, a, b), _volume(s, e, b, c), _volume(s, e, c, a)
    return (x > nothing and y > nothing and z > nothing) or (
        x < -nothing and y < -nothing and z < -nothing
    )


@compiled()
def _volume(a: Float, b: Float, c: Float, d: Float) -> Any:
    """Six times that of a tetrahedron, signed."""
    x, y, z = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    p, q, r = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    s, t, u = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return x * (q * u - r * t) + y * (r * s - p * u) + z * (p * t - q * s)
