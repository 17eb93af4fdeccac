"""A mesh's boundary moved so that its facets, not its nodes, lie on the body's surface.

With the nodes on a convex surface all facets lie inside it, and a mesh of edges h has lost
h^2 / (12 R) of thickness at a radius R: two per cent of the volume of a body of some edges' width,
and more of its bending stiffness. Moving the nodes along their normals so that facets are off by
as little as they can (least squares over the area) brings that back.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from ....core.arrays import Float
from ....core.mesh import Surface, TetMesh, facet_crosses
from ...kernels.signed_distance import distances_of

#: Barycentric coordinates at which a facet is compared with the surface: a quadrature that is exact
#: for what the surface rises above it, to second order.
_SAMPLES = np.array(
    [[3, 3, 0], [0, 3, 3], [3, 0, 3], [4, 1, 1], [1, 4, 1], [1, 1, 4]]
) / 6  # fmt: skip
#: Weight of a node's own move against the facets' distances.
_STIFF = 0.05
#: A move may take this share of a tet's volume at most; less is moved where it would take more.
_MOST = 0.7
_ROUNDS = 2
_DECIMALS = 9  # of mm


def fit_boundary(mesh: TetMesh, surface: Surface) -> TetMesh:
    """The mesh with its boundary nodes moved; those inside stay where they are. Without the last
    digits, in which processors differ."""
    for _ in range(_ROUNDS):
        mesh = _moved(mesh, surface)
    return TetMesh(np.round(mesh.nodes, _DECIMALS) + 0.0, mesh.tets)


def facet_gaps(mesh: TetMesh, surface: Surface) -> tuple[Float, Float]:
    """Middles (f, 3) mm of the boundary's facets, and how far each is at most from the surface
    along its normal (f,), mm."""
    faces = mesh.boundary().faces
    gaps = _gaps(mesh.nodes[faces], surface)
    return mesh.nodes[faces].mean(axis=1), np.abs(gaps).max(axis=1)


def _gaps(corners: Float, surface: Surface) -> Float:
    """From samples of facets (f, 3, 3) outwards to the surface, (f, samples) mm."""
    points = np.einsum("kw,fwi->fki", _SAMPLES, corners)
    nearest = distances_of(surface).nearest(points.reshape(-1, 3))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(np.einsum("fki,fi->fk", nearest.reshape(points.shape) - points, normals))


def _moved(mesh: TetMesh, surface: Surface) -> TetMesh:
    faces, nodes = mesh.boundary().faces, mesh.nodes
    corners = nodes[faces]
    cross = facet_crosses(nodes, faces)
    area = np.linalg.norm(cross, axis=1) / 2
    normals = np.zeros_like(nodes)
    for k in range(3):
        np.add.at(normals, faces[:, k], cross)
    used, index = np.unique(faces, return_inverse=True)
    lengths = np.linalg.norm(normals[used], axis=1, keepdims=True)
    normals[used] /= np.where(lengths > 0, lengths, 1.0)
    # A node's move along its normal shifts a facet by the cosine between their normals.
    cosines = np.einsum("fki,fi->fk", normals[faces], cross / (2 * area[:, None]))
    count = len(_SAMPLES)
    rows = np.repeat(np.arange(len(faces) * count), 3)
    columns = np.repeat(index.reshape(-1, 3), count, axis=0).ravel()
    values = (np.tile(_SAMPLES, (len(faces), 1)) * np.repeat(cosines, count, axis=0)).ravel()
    A = csr_matrix((values, (rows, columns)), shape=(len(faces) * count, len(used)))
    weights = diags_array(np.repeat(area, count))
    stiff = _STIFF * float(area.mean()) * count
    gaps = _gaps(corners, surface).ravel()
    move = spsolve(
        (A.T @ weights @ A + stiff * eye_array(len(used))).tocsc(), A.T @ (weights @ gaps)
    )
    shift = np.zeros_like(nodes)
    shift[used] = move[:, None] * normals[used]
    return TetMesh(nodes + _safe(mesh, shift), mesh.tets)


def _safe(mesh: TetMesh, shift: Float) -> Float:
    """The shift (n, 3), halved at the nodes of tets from which it would take too much."""
    before = mesh.volumes
    for _ in range(8):
        x = (mesh.nodes + shift)[mesh.tets]
        after = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
        bad = np.unique(mesh.tets[after < (1 - _MOST) * before])
        if not len(bad):
            return shift
        shift[bad] *= 0.5
    return np.zeros_like(shift)
