"""Repair how triangles are connected: merge, remove, and separate sheets that touch."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ....core.arrays import Bool, Float, Int
from ....core.mesh import facet_crosses, triangle_edges
from .findings import describe_point, format_count

MAX_PASSES = 30
MERGE_SHARE = 1e-7  # of the size: nearer vertices are merged


def clean_triangles(vertices: Float, faces: Int, size: float) -> tuple[Float, Int, list[str]]:
    """Merge coincident vertices; remove degenerate, duplicate and surplus triangles.

    Args:
        vertices: Corners (n, 3), mm.
        faces: Triangles (m, 3).
        size: Diagonal of the bounding box, mm.

    Returns:
        Vertices, faces, and sentences on what was done.
    """
    sentences: list[str] = []
    _, first, inverse = np.unique(
        np.round(vertices / (MERGE_SHARE * size)), axis=0, return_index=True, return_inverse=True
    )
    if len(first) < len(vertices):
        sentences.append(f"merged {len(vertices) - len(first)} coincident vertices")
    vertices, faces = vertices[first], inverse.reshape(-1)[faces]
    keep = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    _, unique = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    mask = np.zeros(len(faces), bool)
    mask[unique] = True
    mask &= keep
    if not mask.all():
        sentences.append(f"removed {(~mask).sum()} degenerate or doubled triangles")
    faces, lost = _remove_surplus(vertices, faces[mask])
    return vertices, faces, sentences + lost


def _find_patches(faces: Int) -> Int:
    """Return a patch number (m,) for each triangle: triangles joined by two-triangle edges share
    one.
    """
    _, count, index = triangle_edges(faces)
    order = np.argsort(index, kind="stable")
    owner = order // 3
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])[count == 2]
    pairs = owner[starts], owner[starts + 1]
    graph = coo_array((np.ones(len(starts)), pairs), (len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1])


def _remove_surplus(vertices: Float, faces: Int) -> tuple[Int, list[str]]:
    """Remove fins and inner walls: patches that end at edges of three triangles, which then have
    two.

    Open patches go first, then the smallest. If no such patch is left but such edges are, their
    smallest triangles are removed, which leaves holes.
    """
    removed, at = 0, vertices[0]
    sentences: list[str] = []
    for _ in range(MAX_PASSES):
        is_surplus = _find_surplus(vertices, faces)
        if not is_surplus.any():
            break
        removed += int(is_surplus.sum())
        at = vertices[faces[is_surplus][0]].mean(0)
        faces = faces[~is_surplus]
    if removed:
        sentences.append(
            f"removed fins or inner walls of {format_count(removed, 'triangle')}, near"
            f" {describe_point(at)}"
        )
    before = faces
    for _ in range(MAX_PASSES):
        _, count, index = triangle_edges(faces)
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
        text = format_count(len(before) - len(faces), "triangle")
        sentences.append(
            f"removed {text} at edges that have more than two, near {describe_point(at)}"
        )
    return faces, sentences


def _areas(vertices: Float, faces: Int) -> Float:
    return np.asarray(np.linalg.norm(facet_crosses(vertices, faces), axis=1) / 2)


def _find_surplus(vertices: Float, faces: Int) -> Bool:
    """Return the triangles (m,) to remove: of patches that have no such edge in common."""
    _, count, index = triangle_edges(faces)
    odd = (count > 2) & (count % 2 == 1)
    is_surplus = np.zeros(len(faces), bool)
    if not odd.any():
        return is_surplus
    patch = _find_patches(faces)
    area = np.bincount(patch, _areas(vertices, faces))
    of_edge = np.repeat(patch, 3)
    touches = np.bincount(of_edge, odd[index]) > 0
    is_open = np.bincount(of_edge, count[index] == 1) > 0
    # Without the patch, no edge may be left with a single triangle.
    pairs, times = np.unique(np.stack([of_edge, index]), axis=1, return_counts=True)
    alone = (count[pairs[1]] - times) == 1
    harmful = np.bincount(pairs[0], alone, minlength=len(area)) > 0
    candidates = np.nonzero(touches & ~harmful)[0]
    if len(area) == 1:
        return is_surplus
    order = np.argsort(of_edge, kind="stable")
    starts = np.searchsorted(of_edge[order], np.arange(len(area) + 1))
    used = np.zeros(len(count), bool)
    for k in candidates[np.lexsort([area[candidates], ~is_open[candidates]])]:
        patch_edges = index[order[starts[k] : starts[k + 1]]]
        patch_edges = patch_edges[count[patch_edges] > 2]
        if not used[patch_edges].any():
            used[patch_edges] = True
            is_surplus |= patch == k
    return is_surplus


MAX_RETREAT_SHARE = 5e-4  # of the size, for corners that touched
MAX_RETREAT_OF_EDGE = 0.1  # of the distance to their neighbors


def separate_sheets(
    vertices: Float, faces: Int, size: float
) -> tuple[Float, Int, list[str]] | Bool:
    """Separate sheets of closed, oriented triangles that touch at edges or corners.

    In the result triangles are joined only along edges of two triangles; corners that several
    sheets shared are drawn back a little.

    Args:
        vertices: Corners (n, 3), mm.
        faces: Triangles (m, 3).
        size: Diagonal of the bounding box, mm.

    Returns:
        Vertices, faces and sentences on what was done. If solid and empty space do not alternate
        around an edge, there are no such sheets: then the triangles (m,) at these edges.
    """
    joined = _join_corners(vertices, faces)
    if isinstance(joined, np.ndarray):
        return joined
    left, right = joined
    corners = 3 * len(faces)
    graph = coo_array((np.ones(len(left)), (left, right)), (corners, corners))
    count, label = connected_components(graph, directed=False)
    original = np.zeros(count, np.int64)
    original[label] = faces.reshape(-1)
    if count == len(np.unique(faces)):
        return vertices, faces, []
    corners_out = vertices[original]
    faces = label.reshape(-1, 3).astype(np.int64)
    is_shared = np.bincount(original, minlength=len(vertices))[original] > 1
    edges = triangle_edges(faces)[0]
    around = np.zeros_like(corners_out)
    degree = np.bincount(edges.reshape(-1), minlength=count)
    for axis in range(3):
        around[:, axis] = np.bincount(
            edges[:, 0], corners_out[edges[:, 1], axis], count
        ) + np.bincount(edges[:, 1], corners_out[edges[:, 0], axis], count)
    direction = around / degree[:, None] - corners_out
    length = np.linalg.norm(direction, axis=1)
    step = np.minimum(MAX_RETREAT_SHARE * size, MAX_RETREAT_OF_EDGE * length) / np.maximum(
        length, 1e-300
    )
    corners_out = np.where(is_shared[:, None], corners_out + step[:, None] * direction, corners_out)
    largest_move = float((step * length)[is_shared].max())
    places = format_count(len(np.unique(original[is_shared])), "corner")
    return (
        corners_out,
        faces,
        [
            f"separated sheets that touched at {places}, one near"
            f" {describe_point(corners_out[is_shared][0])}: moved"
            f" {largest_move:.2g} mm"
        ],
    )


def _join_corners(vertices: Float, faces: Int) -> tuple[Int, Int] | Bool:
    """Return pairs of corners (3 face + corner) that are one vertex: those at both ends of edges
    across which two triangles are joined. If that is undefined at some edges, return their
    triangles (m,).
    """
    edges, count, index = triangle_edges(faces)
    order = np.argsort(index, kind="stable")
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    first, second = [order[starts[count == 2]]], [order[starts[count == 2] + 1]]
    failed = count % 2 == 1
    for e in np.nonzero((count > 2) & ~failed)[0]:
        sides = order[starts[e] : starts[e] + count[e]]
        pairs = _pair_half_edges(vertices, faces, edges[e], sides)
        if pairs is None:
            failed[e] = True
        else:
            first.append(pairs[0])
            second.append(pairs[1])
    if failed.any():
        return np.asarray(failed[index].reshape(-1, 3).any(1))
    return _edge_ends(faces, np.concatenate(first), np.concatenate(second))


def _edge_ends(faces: Int, first: Int, second: Int) -> tuple[Int, Int]:
    """Return the corners at both ends of joined half-edges (3 face + side)."""
    a, b = first, 3 * (first // 3) + (first % 3 + 1) % 3
    c, d = second, 3 * (second // 3) + (second % 3 + 1) % 3
    flat = faces.reshape(-1)
    same = flat[a] == flat[c]
    return (
        np.concatenate([a, b]),
        np.concatenate([np.where(same, c, d), np.where(same, d, c)]),
    )


def _pair_half_edges(vertices: Float, faces: Int, edge: Int, sides: Int) -> tuple[Int, Int] | None:
    """Return pairs of half-edges with the solid between them, or None if there are none."""
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
    # Seen along the edge, the solid of a triangle with the same direction lies clockwise.
    plus = np.nonzero(ahead)[0]
    return sides[order[plus]], sides[order[plus - 1]]
