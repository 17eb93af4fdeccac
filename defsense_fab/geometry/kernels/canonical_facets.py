"""The facets of a CAD solid, the same for the same solid wherever it comes from.

A script's solid and the STEP file written of it are tessellated with the same points, but in
another order, and where four points lie on a circle, as on cylinders, spheres and tori, with the
other diagonal.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Bool, Float, Int

#: Points closer than this are one, mm (decimals).
DECIMALS = 6
#: Four points lie on a circle if opposite angles add up to pi within this, rad.
_CIRCLE = 1e-3
#: Two facets belong to one smooth face if their normals are no further apart (cosine).
_SMOOTH = np.cos(np.deg2rad(25.0))
_ROUNDS = 100


def canonical(vertices: Float, faces: Int) -> tuple[Float, Int]:
    """Vertices (n, 3) mm merged, rounded and sorted by x, y, z; faces (m, 3) with the smallest
    number first, sorted; of the diagonals of four points on a circle the one that ends at the
    smallest number."""
    points, inverse = np.unique(
        np.round(vertices, DECIMALS) + 0.0, axis=0, return_inverse=True
    )  # no negative zeros
    faces = inverse.reshape(-1)[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    fits, changed = np.zeros(faces.size, bool), np.ones(len(faces), bool)
    for _ in range(_ROUNDS):
        faces, changed = _flip(points, faces, fits, changed)
        if not changed.any():
            break
    return points, _sorted(faces)


def _sorted(faces: Int) -> Int:
    first = faces.argmin(axis=1)
    turned = np.stack([faces[np.arange(len(faces)), (first + k) % 3] for k in range(3)], axis=1)
    return np.asarray(turned[np.lexsort(turned.T[::-1])])


def _flip(points: Float, faces: Int, fits: Bool, changed: Bool) -> tuple[Int, Bool]:
    """The faces with some diagonals changed, each face in one of them at most, and which (m,) were
    changed. `fits` (3 m,) tells of every edge whether the other diagonal ends at a smaller number,
    on the same circle; it is brought up to date for faces that were `changed` before."""
    # Directed edge k of a face runs from its corner k to k + 1, opposite to k + 2.
    begin, end, top = (np.roll(faces, -k, axis=1).ravel() for k in range(3))
    count = len(points)
    forth, back = begin * count + end, end * count + begin
    order = np.argsort(forth)
    known = forth[order]
    one = np.flatnonzero(begin < end)
    at = _place(known, back[one])
    closed = known[at] == back[one]
    one, other = one[closed], order[at[closed]]
    new = changed[one // 3] | changed[other // 3]
    i, j = one[new], other[new]
    a, b, c, d = begin[i], end[i], top[i], top[j]
    better = np.minimum(c, d) < np.minimum(a, b)
    fits[i] = False
    fits[i[better]] = _on_circle(points, a[better], b[better], c[better], d[better])
    one, other = one[fits[one]], other[fits[one]]
    c, d = top[one], top[other]
    there = [known[_place(known, ends)] == ends for ends in (c * count + d, d * count + c)]
    one, other = (x[~(there[0] | there[1])] for x in (one, other))
    a, b, c, d = begin[one], end[one], top[one], top[other]
    out, changed = faces.copy(), np.zeros(len(faces), bool)
    for k in np.lexsort((np.maximum(c, d), np.minimum(c, d))):
        i, j = one[k] // 3, other[k] // 3
        if not (changed[i] or changed[j]):
            out[i], out[j] = (c[k], a[k], d[k]), (d[k], b[k], c[k])
            changed[i] = changed[j] = True
    return out, changed


def _place(known: Int, wanted: Int) -> Int:
    """Of each wanted number in the sorted ones, or of another where it is not among them."""
    return np.asarray(np.minimum(np.searchsorted(known, wanted), len(known) - 1))


def _on_circle(points: Float, a: Int, b: Int, c: Int, d: Int) -> Bool:
    """Whether the triangles a b c and b a d of a smooth face have their corners on one circle, and
    c d crosses a b between its ends."""
    A, B, C, D = (points[i] for i in (a, b, c, d))
    first, second = np.cross(B - A, C - A), np.cross(A - B, D - B)
    lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    smooth = np.einsum("ij,ij->i", first, second) > _SMOOTH * lengths
    circle = np.abs(_angle(A, C, B) + _angle(A, D, B) - np.pi) < _CIRCLE
    return np.asarray(smooth & circle)


def _angle(p: Float, at: Float, q: Float) -> Float:
    u, v = p - at, q - at
    return np.asarray(
        np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
    )
