"""Edges and corners at which a surface touches itself: taken apart."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ....core.arrays import Bool, Float, Int
from ....core.mesh import facet_crosses
from .findings import number, place

# What is wrong with single triangles and edges: merged, removed.

_PASSES = 30
_SAME = 1e-7  # of the size: vertices that are one


def cleaned(vertices: Float, faces: Int, size: float) -> tuple[Float, Int, list[str]]:
    """Merge coincident vertices; remove degenerate, doubled and surplus triangles."""
    done: list[str] = []
    _, first, inverse = np.unique(
        np.round(vertices / (_SAME * size)), axis=0, return_index=True, return_inverse=True
    )
    if len(first) < len(vertices):
        done.append(f"merged {len(vertices) - len(first)} coincident vertices")
    vertices, faces = vertices[first], inverse.reshape(-1)[faces]
    keep = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    _, unique = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    mask = np.zeros(len(faces), bool)
    mask[unique] = True
    mask &= keep
    if not mask.all():
        done.append(f"removed {(~mask).sum()} degenerate or doubled triangles")
    faces, lost = _without_surplus(vertices, faces[mask])
    return vertices, faces, done + lost


def edges_of(faces: Int) -> tuple[Int, Int, Int]:
    """The edges (k, 2) of triangles (m, 3), how many triangles each has (k,), and which (3 m,) are
    the three edges of each triangle, in a row."""
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges, index, count = np.unique(
        np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return edges, count, index.reshape(-1)


def patches_of(faces: Int) -> Int:
    """A number (m,) for each triangle: those joined by edges of just two triangles are one."""
    _, count, index = edges_of(faces)
    order = np.argsort(index, kind="stable")
    owner = order // 3
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])[count == 2]
    pairs = owner[starts], owner[starts + 1]
    graph = coo_array((np.ones(len(starts)), pairs), (len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1])


def _without_surplus(vertices: Float, faces: Int) -> tuple[Int, list[str]]:
    """Without fins and inner walls: patches that end at edges of three triangles, and without which
    these have two. Open ones go first, then the smallest. Where none is left but such edges are,
    their smallest triangles go, which leaves holes."""
    gone, at = 0, vertices[0]
    done: list[str] = []
    for _ in range(_PASSES):
        found = _surplus(vertices, faces)
        if not found.any():
            break
        gone += int(found.sum())
        at = vertices[faces[found][0]].mean(0)
        faces = faces[~found]
    if gone:
        done.append(f"removed fins or inner walls of {number(gone, 'triangle')}, near {place(at)}")
    before = faces
    for _ in range(_PASSES):
        _, count, index = edges_of(faces)
        odd = (count > 2) & (count % 2 == 1)
        if not odd.any():
            break
        owner = np.repeat(np.arange(len(faces)), 3)[odd[index]]
        order = np.lexsort([_areas(vertices, faces)[owner], index[odd[index]]])
        first = np.unique(index[odd[index]][order], return_index=True)[1]
        small = np.zeros(len(faces), bool)
        small[owner[order][first]] = True
        at = vertices[faces[small][0]].mean(0)
        faces = faces[~small]
    if len(faces) < len(before):
        left = number(len(before) - len(faces), "triangle")
        done.append(f"removed {left} at edges that have more than two, near {place(at)}")
    return faces, done


def _areas(vertices: Float, faces: Int) -> Float:
    return np.asarray(np.linalg.norm(facet_crosses(vertices, faces), axis=1) / 2)


def _surplus(vertices: Float, faces: Int) -> Bool:
    """Triangles (m,) to remove: of patches that have no such edge in common."""
    _, count, index = edges_of(faces)
    odd = (count > 2) & (count % 2 == 1)
    gone = np.zeros(len(faces), bool)
    if not odd.any():
        return gone
    patch = patches_of(faces)
    area = np.bincount(patch, _areas(vertices, faces))
    of_edge = np.repeat(patch, 3)
    touches = np.bincount(of_edge, odd[index]) > 0
    is_open = np.bincount(of_edge, count[index] == 1) > 0
    # What each edge would have left without the patch: never one triangle alone.
    pairs, times = np.unique(np.stack([of_edge, index]), axis=1, return_counts=True)
    alone = (count[pairs[1]] - times) == 1
    harmful = np.bincount(pairs[0], alone, minlength=len(area)) > 0
    candidates = np.nonzero(touches & ~harmful)[0]
    if len(area) == 1:
        return gone
    order = np.argsort(of_edge, kind="stable")
    starts = np.searchsorted(of_edge[order], np.arange(len(area) + 1))
    used = np.zeros(len(count), bool)
    for k in candidates[np.lexsort([area[candidates], ~is_open[candidates]])]:
        own = index[order[starts[k] : starts[k + 1]]]
        own = own[count[own] > 2]
        if not used[own].any():
            used[own] = True
            gone |= patch == k
    return gone


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
