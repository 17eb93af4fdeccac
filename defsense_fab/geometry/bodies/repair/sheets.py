"""Edges and corners at which a surface touches itself: taken apart."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ....core.arrays import Bool, Float, Int
from .cleaning import edges_of
from .words import number, place

_APART = 5e-4  # of the size: how far corners that touched are drawn back, at most
_SHARE = 0.1  # of the way to their neighbours, at most


def taken_apart(vertices: Float, faces: Int, size: float) -> tuple[Float, Int, list[str]] | Bool:
    """Closed, oriented triangles as sheets that are joined along edges of two triangles only, each
    sheet's corners that others had too drawn back a little.

    Where around an edge solid and empty space do not take turns, there are no such sheets, and the
    triangles (m,) at these edges are returned.
    """
    joined = _joined(vertices, faces)
    if isinstance(joined, np.ndarray):
        return joined
    left, right = joined
    corners = 3 * len(faces)
    graph = coo_array((np.ones(len(left)), (left, right)), (corners, corners))
    count, label = connected_components(graph, directed=False)
    old = np.zeros(count, np.int64)
    old[label] = faces.reshape(-1)
    if count == len(np.unique(faces)):
        return vertices, faces, []
    made = vertices[old]
    faces = label.reshape(-1, 3).astype(np.int64)
    several = np.bincount(old, minlength=len(vertices))[old] > 1
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    around = np.zeros_like(made)
    degree = np.bincount(edges.reshape(-1), minlength=count)
    for axis in range(3):
        around[:, axis] = np.bincount(edges[:, 0], made[edges[:, 1], axis], count) + np.bincount(
            edges[:, 1], made[edges[:, 0], axis], count
        )
    way = around / degree[:, None] - made
    length = np.linalg.norm(way, axis=1)
    step = np.minimum(_APART * size, _SHARE * length) / np.maximum(length, 1e-300)
    made = np.where(several[:, None], made + step[:, None] * way, made)
    moved = float((step * length)[several].max())
    places = number(len(np.unique(old[several])), "corner")
    return made, faces, [
        f"took sheets apart that touched at {places}, one near {place(made[several][0])}: moved"
        f" {moved:.2g} mm"
    ]  # fmt: skip


def _joined(vertices: Float, faces: Int) -> tuple[Int, Int] | Bool:
    """Pairs of corners (3 face + corner) that are one vertex: those at both ends of edges across
    which two triangles are joined; or the triangles (m,) at edges of which that cannot be said."""
    edges, count, index = edges_of(faces)
    order = np.argsort(index, kind="stable")
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    first, second = [order[starts[count == 2]]], [order[starts[count == 2] + 1]]
    failed = count % 2 == 1
    for e in np.nonzero((count > 2) & ~failed)[0]:
        sides = order[starts[e] : starts[e] + count[e]]
        pairs = _around(vertices, faces, edges[e], sides)
        if pairs is None:
            failed[e] = True
        else:
            first.append(pairs[0])
            second.append(pairs[1])
    if failed.any():
        return np.asarray(failed[index].reshape(-1, 3).any(1))
    return _ends(faces, np.concatenate(first), np.concatenate(second))


def _ends(faces: Int, first: Int, second: Int) -> tuple[Int, Int]:
    """The corners at both ends of half-edges (3 face + side) that are joined."""
    a, b = first, 3 * (first // 3) + (first % 3 + 1) % 3
    c, d = second, 3 * (second // 3) + (second % 3 + 1) % 3
    flat = faces.reshape(-1)
    same = flat[a] == flat[c]
    return (
        np.concatenate([a, b]),
        np.concatenate([np.where(same, c, d), np.where(same, d, c)]),
    )


def _around(vertices: Float, faces: Int, edge: Int, sides: Int) -> tuple[Int, Int] | None:
    """Half-edges in pairs with the solid between them."""
    a, b = vertices[edge]
    axis = (b - a) / np.linalg.norm(b - a)
    third = faces[sides // 3, (sides % 3 + 2) % 3]
    out = vertices[third] - a
    out = out - np.outer(out @ axis, axis)
    along = out[0] / np.linalg.norm(out[0])
    angle = np.arctan2(out @ np.cross(axis, along), out @ along)
    forward = faces[sides // 3, sides % 3] == edge[0]
    order = np.argsort(angle, kind="stable")
    ahead = forward[order]
    if (ahead == np.roll(ahead, 1)).any():
        return None
    # Seen along the edge, the solid of a triangle that runs with it lies clockwise.
    plus = np.nonzero(ahead)[0]
    return sides[order[plus]], sides[order[plus - 1]]
