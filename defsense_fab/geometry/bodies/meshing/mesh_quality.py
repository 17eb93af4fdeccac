"""How well tets are shaped, and how well they follow the body."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
from scipy.sparse import csr_matrix, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from ....core.arrays import Float
from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh, facet_crosses
from ...kernels.surface_queries import signed_distance_of

# A mesh's boundary moved so that its facets, not its nodes, lie on the body's surface.
#
# With the nodes on a convex surface all facets lie inside it, and a mesh of edges h has lost
# h^2 / (12 R) of thickness at a radius R: two per cent of the volume of a body of some edges' width,
# and more of its bending stiffness. Moving the nodes along their normals so that facets are off by
# as little as they can (least squares over the area) brings that back.

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
    nearest = signed_distance_of(surface).nearest(points.reshape(-1, 3))
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


#: What is accepted: relative change of volume, smallest dihedral angle (degrees), and the distance
#: of the boundary from the surface, in edges of the tets.
_VOLUME, _SHARPEST, _AWAY = 0.02, 1.0, 1.0


@dataclass(frozen=True)
class MeshQuality:
    """Counts; smallest dihedral angle (degrees); boundary deviation (mm); volume change."""

    tets: int
    nodes: int
    min_dihedral: float
    boundary_deviation: float
    volume_change: float


def checked(mesh: TetMesh, surface: Surface, edge_length: float) -> TetMesh:
    """The mesh, of edges of `edge_length` mm. Raises MeshingError where it is not sound."""
    found = quality(mesh, surface)
    # Written so that what is not a number does not pass.
    sound = abs(found.volume_change) <= _VOLUME
    if not (sound and found.boundary_deviation <= _AWAY * edge_length):
        raise MeshingError(
            f"the mesh differs from the body by {100 * found.volume_change:.2g} % of its volume and"
            f" {found.boundary_deviation:.2g} mm",
            code="mesh-differs-from-body",
        )
    if not found.min_dihedral >= _SHARPEST:
        raise MeshingError(
            f"a tet has an angle of {found.min_dihedral:.2g} degrees",
            code="tet-too-flat",
            angle=found.min_dihedral,
        )
    return mesh


def quality(mesh: TetMesh, surface: Surface) -> MeshQuality:
    """How well the mesh is shaped and how well it follows `surface`."""
    boundary = mesh.boundary()
    used = np.unique(boundary.faces)
    forth = signed_distance_of(surface).unsigned(mesh.nodes[used])
    back = igl.point_mesh_squared_distance(
        surface.vertices, mesh.nodes, np.ascontiguousarray(boundary.faces)
    )[0]
    return MeshQuality(
        tets=len(mesh.tets),
        nodes=len(mesh.nodes),
        min_dihedral=float(np.rad2deg(dihedrals(mesh).min())),
        boundary_deviation=float(max(forth.max(), np.sqrt(back.max()))),
        volume_change=float(mesh.volumes.sum() / surface.volume - 1),
    )


def dihedrals(mesh: TetMesh) -> Float:
    """The six dihedral angles of each tet, (m, 6) rad."""
    x = mesh.nodes[mesh.tets]
    faces = [(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)]
    normals = []
    for a, b, c in faces:
        n = np.cross(x[:, b] - x[:, a], x[:, c] - x[:, a])
        normals.append(n / np.linalg.norm(n, axis=1, keepdims=True))
    angles = [
        np.pi - np.arccos(np.clip(np.einsum("ij,ij->i", normals[i], normals[j]), -1, 1))
        for i in range(4)
        for j in range(i + 1, 4)
    ]
    return np.stack(angles, axis=1)
