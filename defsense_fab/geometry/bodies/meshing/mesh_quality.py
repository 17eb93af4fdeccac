"""How well tets are shaped, and how well they follow the body."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np

from ....core.arrays import Float
from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh
from ...kernels.signed_distance import distances_of

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
    forth = distances_of(surface).unsigned(mesh.nodes[used])
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
