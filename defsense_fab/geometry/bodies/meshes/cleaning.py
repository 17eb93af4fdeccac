"""What is wrong with single triangles and edges: merged, removed."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ....core.arrays import Float, Int
from .words import number, place

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
    these have two. Open ones go first, then the smallest."""
    done: list[str] = []
    for _ in range(100):
        _, count, index = edges_of(faces)
        odd = (count > 2) & (count % 2 == 1)
        if not odd.any():
            break
        patch = patches_of(faces)
        found = _surplus(vertices, faces, patch, count, index)
        if found is None:
            break
        gone = patch == found
        at = vertices[faces[gone]].mean((0, 1))
        done.append(
            f"removed a fin or inner wall of {number(int(gone.sum()), 'triangle')} near {place(at)}"
        )
        faces = faces[~gone]
    return faces, done


def _surplus(vertices: Float, faces: Int, patch: Int, count: Int, index: Int) -> int | None:
    """The patch to remove."""
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.bincount(patch, np.linalg.norm(cross, axis=1))
    of_edge = np.repeat(patch, 3)
    odd = (count > 2) & (count % 2 == 1)
    touches = np.bincount(of_edge, odd[index]) > 0
    is_open = np.bincount(of_edge, count[index] == 1) > 0
    # What each edge would have left without the patch: never one triangle alone.
    pairs, times = np.unique(np.stack([of_edge, index]), axis=1, return_counts=True)
    alone = (count[pairs[1]] - times) == 1
    harmful = np.bincount(pairs[0], alone, minlength=len(area)) > 0
    candidates = np.nonzero(touches & ~harmful)[0]
    if not len(candidates) or len(area) == 1:
        return None
    order = np.lexsort([area[candidates], ~is_open[candidates]])
    return int(candidates[order[0]])
