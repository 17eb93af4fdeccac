"""Move nodes onto the borders of regions, so that a region ends where the device says.

A region holds the nodes inside it. On a mesh made without the region its border is a staircase up
to an edge short of the shape, and poses then depend on the mesh: the free length of a bar differs
by a percent and with it every signal. Moving the nodes nearest to the border onto it (the warp of
isosurface stuffing, Labelle & Shewchuk 2007) removes that error.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.device.regions import Shape
from ....core.mesh import TetMesh, triangle_edges

TET_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
#: No tet may become worse than this, or much worse than it was (see `tet_quality`).
MIN_TET_QUALITY = 0.2
#: Faces of the surface may not turn by more than this when a node of theirs moves (cosine).
MAX_TURN_COSINE = np.cos(np.deg2rad(2.0))
#: Two faces that meet at more than this form a crease, which its nodes may not leave.
CREASE_COSINE = np.cos(np.deg2rad(40.0))


def conform_to_regions(mesh: TetMesh, shapes: Sequence[Shape]) -> TetMesh:
    """Move nodes near the borders of regions onto them, just inside.

    The surface keeps its form, and no tet becomes a sliver: where that is impossible, a node stays.
    Where two borders compete for a node, the order of the shapes does not matter.

    Args:
        mesh: The mesh.
        shapes: The regions.

    Returns:
        The mesh with moved nodes.
    """
    nodes = mesh.nodes.copy()
    surface = _Surface(mesh)
    around = cells_at_nodes(mesh.tets, len(nodes))
    settled = np.zeros(len(nodes), bool)
    edges = np.unique(np.sort(mesh.tets[:, TET_EDGES].reshape(-1, 2), axis=1), axis=0)
    for shape in sorted(shapes, key=_sort_key):
        inside = shape.contains(nodes)
        crossing = edges[inside[edges[:, 0]] != inside[edges[:, 1]]]
        if len(crossing) == 0:
            continue
        points = _find_border(shape, nodes, crossing, inside)
        ends = np.concatenate([crossing, crossing[:, ::-1]])  # (node that moves, other end)
        target = np.concatenate([points, points])
        distance = np.linalg.norm(nodes[ends[:, 0]] - target, axis=1)
        on_border = np.zeros(len(nodes), bool)
        for i in np.argsort(distance, kind="stable"):
            n, other = ends[i]
            if on_border[n] or on_border[other] or settled[n]:
                continue
            if surface.has(n) and not surface.allows(n, other):
                continue
            if _keeps_quality(nodes, mesh.tets, around[n], n, target[i]) and surface.keeps(
                nodes, n, target[i]
            ):
                nodes[n] = target[i]
                on_border[n] = True
        settled |= on_border
    return TetMesh(nodes, mesh.tets)


def _sort_key(shape: Shape) -> tuple[str, list[list[float]]]:
    """Return a key that orders shapes by their values."""
    return type(shape).__name__, [np.ravel(v).tolist() for v in vars(shape).values()]


def _find_border(shape: Shape, nodes: Float, edges: Int, inside: Bool) -> Float:
    """Return the points (e, 3) just inside a shape at which edges (e, 2) leave it, by bisection."""
    first = inside[edges[:, 0]][:, None]
    a = np.where(first, nodes[edges[:, 0]], nodes[edges[:, 1]])
    b = np.where(first, nodes[edges[:, 1]], nodes[edges[:, 0]])
    for _ in range(50):
        middle = (a + b) / 2
        is_within = shape.contains(middle)[:, None]
        a, b = np.where(is_within, middle, a), np.where(is_within, b, middle)
    return np.asarray(a)


def cells_at_nodes(cells: Int, count: int) -> list[Int]:
    """Return the indices of the cells at each node."""
    order = np.argsort(cells.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(cells.ravel(), minlength=count))
    return np.split(order // cells.shape[1], ends[:-1])


def tet_quality(x: Float) -> Float:
    """Return 6 sqrt(2) volume / (RMS edge)^3 of tets (k, 4, 3): 1 for a regular one, < 0 if
    inverted.
    """
    volume = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    edges = x[:, TET_EDGES[:, 0]] - x[:, TET_EDGES[:, 1]]
    return np.asarray(6 * np.sqrt(2) * volume / ((edges**2).sum(-1).mean(-1)) ** 1.5)


def _keeps_quality(nodes: Float, tets: Int, cells: Int, n: int, target: Float) -> bool:
    """Whether the tets at node `n` stay well shaped when it moves to `target`."""
    x = nodes[tets[cells]]
    before = tet_quality(x).min()
    x[tets[cells] == n] = target
    return bool(tet_quality(x).min() > min(MIN_TET_QUALITY, 0.8 * before))


class _Surface:
    """The boundary's faces and edges, queried for single nodes."""

    def __init__(self, mesh: TetMesh) -> None:
        boundary = mesh.boundary()
        self._faces = boundary.faces
        self._around = cells_at_nodes(self._faces, len(mesh.nodes))
        edges, _, index = triangle_edges(self._faces)
        # The sum of an edge's unit normals is short where its faces fold.
        total = np.zeros((len(edges), 3))
        np.add.at(total, index, np.repeat(boundary.normals, 3, axis=0))
        folded = (total**2).sum(1) < 2 + 2 * CREASE_COSINE
        self._edges = {(int(a), int(b)): bool(f) for (a, b), f in zip(edges, folded, strict=True)}
        self._creases = np.bincount(edges[folded].ravel(), minlength=len(mesh.nodes))

    def has(self, n: int) -> bool:
        """Return whether a node lies on the boundary."""
        return len(self._around[n]) > 0

    def allows(self, n: int, other: int) -> bool:
        """Return whether a surface node may move towards another: along the surface, along its
        crease if it is on one, and not at all from a corner.
        """
        folded = self._edges.get((min(n, other), max(n, other)))
        if folded is None or self._creases[n] not in (0, 2):
            return False
        return folded or self._creases[n] == 0

    def keeps(self, nodes: Float, n: int, target: Float) -> bool:
        """Return whether the faces at a node keep their direction when it moves."""
        faces_at_node = self._around[n]
        if len(faces_at_node) == 0:
            return True
        x = nodes[self._faces[faces_at_node]]
        before = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        x[self._faces[faces_at_node] == n] = target
        after = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        scale = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        return bool(((before * after).sum(1) > MAX_TURN_COSINE * scale).all())
