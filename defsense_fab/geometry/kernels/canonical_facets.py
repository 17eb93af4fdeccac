"""Bring the facets of a CAD solid into one canonical order and choice of diagonals.

A script's solid and the STEP file written of it are tessellated with the same points, but in
another order, and with the other diagonal where four points lie on a circle, as on cylinders,
spheres and tori.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Bool, Float, Int

#: Decimals of mm to which points are rounded: closer points are merged.
DECIMALS = 6
#: Four points lie on a circle if opposite angles add up to pi within this.
CIRCLE_TOLERANCE_RAD = 1e-3
#: Two facets belong to one smooth face if the cosine between their normals is larger.
SMOOTH_COSINE = np.cos(np.deg2rad(25.0))
MAX_ROUNDS = 100


def canonicalize(vertices: Float, faces: Int) -> tuple[Float, Int]:
    """Return the same facets for the same solid, wherever it comes from.

    Args:
        vertices: Corners (n, 3), mm.
        faces: Triangles (m, 3).

    Returns:
        The vertices merged, rounded and sorted by x, y, z; and the faces, each with its smallest
        index first, sorted. Of the two diagonals of four points on a circle, the one that ends at
        the smallest index is taken.
    """
    points, inverse = np.unique(
        np.round(vertices, DECIMALS) + 0.0, axis=0, return_inverse=True
    )  # + 0.0: no negative zeros
    faces = inverse.reshape(-1)[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    fits, changed = np.zeros(faces.size, bool), np.ones(len(faces), bool)
    for _ in range(MAX_ROUNDS):
        faces, changed = _flip(points, faces, fits, changed)
        if not changed.any():
            break
    return points, _sort_faces(faces)


def _sort_faces(faces: Int) -> Int:
    first = faces.argmin(axis=1)
    turned = np.stack([faces[np.arange(len(faces)), (first + k) % 3] for k in range(3)], axis=1)
    return np.asarray(turned[np.lexsort(turned.T[::-1])])


def _flip(points: Float, faces: Int, fits: Bool, changed: Bool) -> tuple[Int, Bool]:
    """Change some diagonals, each face at most once.

    `fits` (3 m,) says of each edge whether the other diagonal ends at a smaller index, on the same
    circle; it is updated for the faces that were `changed` (m,) in the previous round. Return the
    faces and which of them changed.
    """
    # Directed edge k of a face runs from its corner k to k + 1, opposite to k + 2.
    start, end, top = (np.roll(faces, -k, axis=1).ravel() for k in range(3))
    count = len(points)
    forth, back = start * count + end, end * count + start
    order = np.argsort(forth)
    sorted_edges = forth[order]
    first = np.flatnonzero(start < end)
    position = _find(sorted_edges, back[first])
    is_closed = sorted_edges[position] == back[first]
    first, other = first[is_closed], order[position[is_closed]]
    is_stale = changed[first // 3] | changed[other // 3]
    i, j = first[is_stale], other[is_stale]
    a, b, c, d = start[i], end[i], top[i], top[j]
    better = np.minimum(c, d) < np.minimum(a, b)
    fits[i] = False
    fits[i[better]] = _on_circle(points, a[better], b[better], c[better], d[better])
    first, other = first[fits[first]], other[fits[first]]
    c, d = top[first], top[other]
    exists = [
        sorted_edges[_find(sorted_edges, ends)] == ends for ends in (c * count + d, d * count + c)
    ]
    first, other = (x[~(exists[0] | exists[1])] for x in (first, other))
    a, b, c, d = start[first], end[first], top[first], top[other]
    out, changed = faces.copy(), np.zeros(len(faces), bool)
    for k in np.lexsort((np.maximum(c, d), np.minimum(c, d))):
        i, j = first[k] // 3, other[k] // 3
        if not (changed[i] or changed[j]):
            out[i], out[j] = (c[k], a[k], d[k]), (d[k], b[k], c[k])
            changed[i] = changed[j] = True
    return out, changed


def _find(values: Int, queries: Int) -> Int:
    """Return the index of each value in the sorted values, or any index if it is absent."""
    return np.asarray(np.minimum(np.searchsorted(values, queries), len(values) - 1))


def _on_circle(points: Float, a: Int, b: Int, c: Int, d: Int) -> Bool:
    """Whether the triangles a b c and b a d belong to a smooth face and have their corners on one
    circle, so that c d crosses a b between its ends.
    """
    A, B, C, D = (points[i] for i in (a, b, c, d))
    first, second = np.cross(B - A, C - A), np.cross(A - B, D - B)
    lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    smooth = np.einsum("ij,ij->i", first, second) > SMOOTH_COSINE * lengths
    circle = np.abs(_angle(A, C, B) + _angle(A, D, B) - np.pi) < CIRCLE_TOLERANCE_RAD
    return np.asarray(smooth & circle)


def _angle(p: Float, at: Float, q: Float) -> Float:
    u, v = p - at, q - at
    return np.asarray(
        np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
    )
