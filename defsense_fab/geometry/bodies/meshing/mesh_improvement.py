"""Improve the few flat tets of a mesh: cut them off the boundary, and move their nodes.

Flat tets lie under the skin, where triangles of the surface meet at a flat angle: a mesher that
keeps the surface's triangles cannot avoid them. One whose two outer triangles lie in a plane is
removed, which flips an edge of the boundary. Nodes of the others are moved to where the flat angles
are largest, on the boundary along the surface (optimization-based smoothing of Freitag &
Ollivier-Gooch 1997, "Tetrahedral mesh improvement using swapping and smoothing").
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.mesh import Surface, TetMesh, facet_crosses, triangle_edges
from ...kernels.surface_queries import signed_distance_of
from .mesh_quality import DECIMALS, dihedral_angles, dihedrals_of
from .region_conforming import CREASE_COSINE, cells_at_nodes
from .simplification import is_creased

#: Tets with a smaller angle are flat, and what smoothing aims at, degrees.
FLAT_DEG, GOAL_DEG = 12.0, 20.0
#: Least angle between the outer triangles of a tet that is removed, degrees.
MIN_FLAT_DEG = 150.0
ROUNDS, SWEEPS = 3, 4
#: Meshes with a larger share of flat tets get one round only: other meshers do better.
MAX_FLAT_SHARE = 0.05
#: First distance that a node is moved, in mean edges at it.
MOVE_EDGES = 0.25
#: Penalty of an inverted tet, in squared degrees.
INVERTED = 1e6
#: Unit vectors to the corners, edges and faces of a cube.
DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


def improve_flat_tets(mesh: TetMesh, surface: Surface) -> TetMesh:
    """Return the mesh with fewer flat tets; a mesh without any is returned as it is.

    Args:
        mesh: The mesh.
        surface: Surface of the body, along which nodes of the boundary move.
    """
    is_flat = np.rad2deg(dihedral_angles(mesh).min(axis=1)) < FLAT_DEG
    if not is_flat.any():
        return mesh
    has_creases = is_creased(surface)
    for _ in range(ROUNDS if is_flat.mean() < MAX_FLAT_SHARE else 1):
        mesh = _smooth(_peel(mesh), surface, has_creases)
        if np.rad2deg(dihedral_angles(mesh).min()) >= FLAT_DEG:
            break
    used, tets = np.unique(mesh.tets, return_inverse=True)
    return TetMesh(mesh.nodes[used], tets.reshape(mesh.tets.shape))


def _peel(mesh: TetMesh) -> TetMesh:
    """Remove flat tets that have two triangles on the boundary in one plane."""
    while True:
        angles = np.rad2deg(dihedral_angles(mesh))
        is_flat = angles.min(axis=1) < FLAT_DEG
        faces = np.sort(mesh.boundary().faces, axis=1)
        outer = _keys(faces, len(mesh.nodes))
        edges = {tuple(e) for e in triangle_edges(faces)[0].tolist()}
        removed: list[int] = []
        touched: set[int] = set()
        for k in np.flatnonzero(is_flat).tolist():
            corners = mesh.tets[k]
            sides = np.sort(corners[OPPOSITE], axis=1)
            on_boundary = np.flatnonzero(np.isin(_keys(sides, len(mesh.nodes)), outer))
            if len(on_boundary) != 2:
                continue
            i, j = on_boundary.tolist()  # the triangles without corner i and without corner j
            new = tuple(sorted((int(corners[i]), int(corners[j]))))
            is_plane = angles[k, PAIRS.index((i, j))] > MIN_FLAT_DEG
            if is_plane and new not in edges and touched.isdisjoint(corners.tolist()):
                removed.append(k)
                touched.update(corners.tolist())
        if not removed:
            return mesh
        mesh = TetMesh(mesh.nodes, np.delete(mesh.tets, removed, axis=0))


#: Corners of the triangle opposite to each corner, and the pairs of triangles of each angle.
OPPOSITE = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
PAIRS = [(i, j) for i in range(4) for j in range(i + 1, 4)]


def _keys(triangles: Int, count: int) -> Int:
    """Return a number for each sorted triangle (n, 3)."""
    return np.asarray((triangles[:, 0] * count + triangles[:, 1]) * count + triangles[:, 2])


def _smooth(mesh: TetMesh, surface: Surface, has_creases: bool) -> TetMesh:
    """Move the nodes of flat tets."""
    nodes, tets = mesh.nodes.copy(), mesh.tets
    around = cells_at_nodes(tets, len(nodes))
    normals, is_held = _boundary_normals(mesh)
    on_boundary = (normals != 0).any(axis=1)
    distances = signed_distance_of(surface)
    offset = np.zeros_like(nodes)
    offset[on_boundary] = nodes[on_boundary] - distances.nearest(nodes[on_boundary])
    is_held &= has_creases
    for sweep in range(SWEEPS):
        flat = np.rad2deg(dihedral_angles(TetMesh(nodes, tets)).min(axis=1)) < GOAL_DEG
        for n in np.unique(tets[flat]).tolist():
            if is_held[n]:
                continue
            cells = tets[around[n]]
            edge = np.linalg.norm(nodes[cells] - nodes[n], axis=2).mean() * 4 / 3
            by = MOVE_EDGES * 0.5**sweep * edge * DIRECTIONS
            to = nodes[n] + by
            if on_boundary[n]:
                to = distances.nearest(to - np.outer(by @ normals[n], normals[n])) + offset[n]
            to = np.concatenate([nodes[n][None], to])
            penalty = _penalty(nodes, cells, n, to)
            nodes[n] = np.round(to[penalty.argmin()], DECIMALS)
    return TetMesh(nodes, tets)


def _boundary_normals(mesh: TetMesh) -> tuple[Float, Bool]:
    """Return unit normals (n, 3) at nodes, 0 inside, and whether folds (n,) meet there."""
    boundary = mesh.boundary()
    normals = np.zeros_like(mesh.nodes)
    cross = facet_crosses(mesh.nodes, boundary.faces)
    for k in range(3):
        np.add.at(normals, boundary.faces[:, k], cross)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    edges, _, index = triangle_edges(boundary.faces)
    total = np.zeros((len(edges), 3))
    np.add.at(total, index, np.repeat(boundary.normals, 3, axis=0))
    is_fold = (total**2).sum(1) < 2 + 2 * CREASE_COSINE
    held = np.zeros(len(mesh.nodes), bool)
    held[edges[is_fold]] = True
    return normals / np.where(length > 0, length, 1.0), held


def _penalty(nodes: Float, cells: Int, n: int, to: Float) -> Float:
    """Return how flat the tets `cells` at node `n` are if it moves to each of the points (c, 3)."""
    x = np.broadcast_to(nodes[cells], (len(to), *cells.shape, 3)).copy()
    x[:, cells == n] = to[:, None]
    angles = np.rad2deg(dihedrals_of(x.reshape(-1, 4, 3)).min(axis=1))
    edges = x[..., 1:, :] - x[..., :1, :]
    volume = np.einsum("...i,...i", edges[..., 0, :], np.cross(edges[..., 1, :], edges[..., 2, :]))
    lack = np.maximum(GOAL_DEG - angles, 0.0).reshape(volume.shape) ** 2
    # Rounded, so that the choice between equal moves does not depend on the processor.
    return np.asarray(np.round(np.where(volume > 0, lack, INVERTED).sum(axis=1), 6))
