"""A body's surface to tetrahedra (fTetWild, Hu et al. 2020), with a report of their quality."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.device import MeshSpec
from ...core.errors import MeshingError
from ...core.mesh import Surface, TetMesh
from . import ftetwild
from .child_process import Failure, finished


@dataclass(frozen=True)
class MeshQuality:
    """Counts; smallest dihedral angle (degrees); boundary deviation (mm); volume change."""

    tets: int
    nodes: int
    min_dihedral: float
    boundary_deviation: float
    volume_change: float


def tetrahedralise(
    surface: Surface,
    edge_length: float,
    on_step: Callable[[str], None] | None = None,
    time_limit: float = MeshSpec.time_limit,
) -> TetMesh:
    """Tets of about `edge_length` mm inside `surface`. Not repeatable: store the result.

    Raises MeshingError where the edge length does not fit the body, or the mesher fails or takes
    more than `time_limit` s.
    """
    size = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    if edge_length < 1e-4 * size or 8.5 * surface.volume / edge_length**3 > 2e6:
        raise MeshingError(
            f"device.toml: mesh.edge_length: {edge_length:g} mm gives more than 2e6 tets; use"
            f" {(8.5 * surface.volume / 1e5) ** (1 / 3):.2g} mm or more"
        )
    if edge_length > size:
        raise MeshingError(
            f"device.toml: mesh.edge_length: {edge_length:g} mm is more than the body's size of"
            f" {size:.3g} mm; use a fifth of the thickness"
        )
    if on_step:
        on_step("tetrahedralising")
    epsilon = min(1e-3, 0.02 * edge_length / size)
    nodes, tets = _mesh(surface, edge_length, epsilon, time_limit)
    return _tidy(np.asarray(nodes, float), np.asarray(tets, np.int64))


def _mesh(
    surface: Surface, edge_length: float, epsilon: float, time_limit: float
) -> tuple[Float, Int]:
    failure = Failure(
        MeshingError,
        "the mesher",
        "repair the body's surface",
        "use a larger [mesh] edge_length, or raise [mesh] time_limit in device.toml",
    )

    def give(folder: Path) -> None:
        np.savez(
            folder / ftetwild.IN,
            vertices=surface.vertices,
            faces=np.asarray(surface.faces, np.int32),
            edge_length=edge_length,
            epsilon=epsilon,
        )

    with (
        finished(ftetwild.__name__, give, ftetwild.OUT, time_limit, failure) as folder,
        np.load(folder / ftetwild.OUT) as made,
    ):
        if "error" in made:
            raise MeshingError(
                f"the mesher failed: {made['error']}; repair the body's surface, or use another"
                " [mesh] edge_length"
            )
        return made["nodes"], made["tets"]


def _tidy(nodes: Float, tets: Int) -> TetMesh:
    if len(tets) == 0:
        raise MeshingError("the mesher returned no tets; is the surface closed?")
    x = nodes[tets]
    volume = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    tets = np.where((volume < 0)[:, None], tets[:, [0, 2, 1, 3]], tets)
    tets = tets[np.abs(volume) > 1e-9 * np.abs(volume).mean()]
    used, index = np.unique(tets, return_inverse=True)
    return TetMesh(nodes[used], index.reshape(-1, 4).astype(np.int64))


def quality(mesh: TetMesh, surface: Surface) -> MeshQuality:
    """How well the mesh is shaped and how well it follows `surface`."""
    import igl

    boundary = mesh.boundary()
    used = np.unique(boundary.faces)
    forth = igl.point_mesh_squared_distance(
        mesh.nodes[used], surface.vertices, np.ascontiguousarray(surface.faces)
    )[0]
    back = igl.point_mesh_squared_distance(
        surface.vertices, mesh.nodes, np.ascontiguousarray(boundary.faces)
    )[0]
    return MeshQuality(
        tets=len(mesh.tets),
        nodes=len(mesh.nodes),
        min_dihedral=float(np.rad2deg(_dihedrals(mesh).min())),
        boundary_deviation=float(np.sqrt(max(forth.max(), back.max()))),
        volume_change=float(mesh.volumes.sum() / surface.volume - 1),
    )


def _dihedrals(mesh: TetMesh) -> Float:
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
