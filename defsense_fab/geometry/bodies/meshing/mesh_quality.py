"""Fit the boundary of a mesh to its body, and measure how well a mesh is shaped and follows the
body.

With the boundary nodes on a convex surface all facets lie inside it, and a mesh of edges h has lost
h^2 / (12 R) of thickness at a radius R: two per cent of the volume of a body that is some edges
wide, and more of its bending stiffness. Moving the nodes along their normals so that the facets are
as near as possible (least squares over the area) restores that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix, diags_array, eye_array
from scipy.sparse.linalg import spsolve

from ....core.arrays import Float
from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh, facet_crosses
from ...kernels.surface_queries import SignedDistance, signed_distance_of

#: Barycentric coordinates at which a facet is compared with the surface: a quadrature that is exact
#: to second order.
FACET_SAMPLES = np.array([[3, 3, 0], [0, 3, 3], [3, 0, 3], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6
#: Weight of the size of moves against the distances of facets.
MOVE_WEIGHT = 0.05
#: Largest share of its volume that a move may take from a tet.
MAX_VOLUME_TAKEN = 0.7
FIT_ROUNDS = 2
DECIMALS = 9  # of mm


def fit_boundary(mesh: TetMesh, surface: Surface) -> TetMesh:
    """Move the boundary nodes so that the facets, not the nodes, lie on the surface.

    Args:
        mesh: The mesh; nodes inside stay where they are.
        surface: Surface of the body.

    Returns:
        The mesh, rounded so that results do not depend on the processor.
    """
    for _ in range(FIT_ROUNDS):
        mesh = _fit_once(mesh, surface)
    return TetMesh(np.round(mesh.nodes, DECIMALS) + 0.0, mesh.tets)


def measure_facet_gaps(mesh: TetMesh, surface: Surface) -> tuple[Float, Float]:
    """Return the centers (f, 3) of the boundary's facets, and the largest distance (f,) of each
    from the surface along its normal, mm.
    """
    faces = mesh.boundary().faces
    gaps = _sample_gaps(mesh.nodes[faces], surface)
    return mesh.nodes[faces].mean(axis=1), np.abs(gaps).max(axis=1)


def _sample_gaps(corners: Float, surface: Surface) -> Float:
    """Return the distances (f, samples) from points of facets (f, 3, 3) outwards to the surface,
    mm.
    """
    points = np.einsum("kw,fwi->fki", FACET_SAMPLES, corners)
    nearest = signed_distance_of(surface).nearest(points.reshape(-1, 3))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(np.einsum("fki,fi->fk", nearest.reshape(points.shape) - points, normals))


def _fit_once(mesh: TetMesh, surface: Surface) -> TetMesh:
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
    count = len(FACET_SAMPLES)
    rows = np.repeat(np.arange(len(faces) * count), 3)
    columns = np.repeat(index.reshape(-1, 3), count, axis=0).ravel()
    values = (np.tile(FACET_SAMPLES, (len(faces), 1)) * np.repeat(cosines, count, axis=0)).ravel()
    A = csr_matrix((values, (rows, columns)), shape=(len(faces) * count, len(used)))
    weights = diags_array(np.repeat(area, count))
    stiffness = MOVE_WEIGHT * float(area.mean()) * count
    gaps = _sample_gaps(corners, surface).ravel()
    move = spsolve(
        (A.T @ weights @ A + stiffness * eye_array(len(used))).tocsc(), A.T @ (weights @ gaps)
    )
    shift = np.zeros_like(nodes)
    shift[used] = move[:, None] * normals[used]
    return TetMesh(nodes + _limit_shift(mesh, shift), mesh.tets)


def _limit_shift(mesh: TetMesh, shift: Float) -> Float:
    """Halve the shift (n, 3) at the nodes of tets that it would shrink too much."""
    before = mesh.volumes
    for _ in range(8):
        x = (mesh.nodes + shift)[mesh.tets]
        after = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
        bad = np.unique(mesh.tets[after < (1 - MAX_VOLUME_TAKEN) * before])
        if not len(bad):
            return shift
        shift[bad] *= 0.5
    return np.zeros_like(shift)


#: Limits: relative change of volume, smallest dihedral angle, and distance of the boundary from the
#: surface in edges of the tets.
MAX_VOLUME_CHANGE, MIN_DIHEDRAL_DEG, MAX_DEVIATION_EDGES = 0.02, 1.0, 1.0


@dataclass(frozen=True)
class MeshQuality:
    """Quality of a mesh.

    Attributes:
        tets: Number of tets.
        nodes: Number of nodes.
        min_dihedral: Smallest dihedral angle, degrees.
        boundary_deviation: Largest distance between boundary and surface, mm.
        volume_change: Relative change of the volume.
    """

    tets: int
    nodes: int
    min_dihedral: float
    boundary_deviation: float
    volume_change: float


def check_mesh(mesh: TetMesh, surface: Surface, edge_length: float) -> TetMesh:
    """Return the mesh if it is sound.

    Args:
        mesh: The mesh.
        surface: Surface of the body.
        edge_length: Requested edge length, mm.

    Raises:
        MeshingError: If the mesh differs from the body or has flat tets.
    """
    quality = measure_quality(mesh, surface)
    # Written so that NaN does not pass.
    is_volume_kept = abs(quality.volume_change) <= MAX_VOLUME_CHANGE
    if not (is_volume_kept and quality.boundary_deviation <= MAX_DEVIATION_EDGES * edge_length):
        raise MeshingError(
            f"the mesh differs from the body by {100 * quality.volume_change:.2g} % of its"
            f" volume and"
            f" {quality.boundary_deviation:.2g} mm",
            code="mesh-differs-from-body",
        )
    if not quality.min_dihedral >= MIN_DIHEDRAL_DEG:
        raise MeshingError(
            f"a tet has an angle of {quality.min_dihedral:.2g} degrees",
            code="tet-too-flat",
            angle=quality.min_dihedral,
        )
    return mesh


def measure_quality(mesh: TetMesh, surface: Surface) -> MeshQuality:
    """Return how well a mesh is shaped and how well it follows `surface`."""
    boundary = mesh.boundary()
    used = np.unique(boundary.faces)
    to_surface = signed_distance_of(surface).unsigned(mesh.nodes[used])
    to_boundary = SignedDistance(boundary).unsigned(surface.vertices)
    return MeshQuality(
        tets=len(mesh.tets),
        nodes=len(mesh.nodes),
        min_dihedral=float(np.rad2deg(dihedral_angles(mesh).min())),
        boundary_deviation=float(max(to_surface.max(), to_boundary.max())),
        volume_change=float(mesh.volumes.sum() / surface.volume - 1),
    )


#: Bounds on dihedral angles: of their first percentile, and of the least one outside of tets on an
#: edge of the body sharper than `SHARP_DEG`, which have to be as flat, degrees.
MIN_PERCENTILE_DEG, MIN_LEAST_DEG, SHARP_DEG = 12.0, 5.0, 15.0
#: The edge at which the two triangles of each angle of `dihedrals_of` meet.
ANGLE_EDGES = np.array([[2, 3], [1, 3], [1, 2], [0, 3], [0, 2], [0, 1]])


def bound_ratio(mesh: TetMesh) -> float:
    """Return by how much dihedral angles exceed their bounds: the mesh keeps them from 1 on."""
    angles = np.rad2deg(dihedral_angles(mesh))
    ends = np.sort(mesh.tets[:, ANGLE_EDGES], axis=2)
    _, index = np.unique(ends[..., 0] * len(mesh.nodes) + ends[..., 1], return_inverse=True)
    index = index.reshape(angles.shape)
    around = np.bincount(index.ravel(), angles.ravel())  # 360 inside the body
    is_free = (around[index] >= SHARP_DEG).all(axis=1)
    least = float(angles[is_free].min(initial=90.0))
    return min(float(np.percentile(angles, 1)) / MIN_PERCENTILE_DEG, least / MIN_LEAST_DEG)


def dihedral_angles(mesh: TetMesh) -> Float:
    """Return the six dihedral angles (m, 6) of each tet, rad."""
    return dihedrals_of(mesh.nodes[mesh.tets])


def dihedrals_of(x: Float) -> Float:
    """Return the six dihedral angles (m, 6) of tets with corners (m, 4, 3), rad."""
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
