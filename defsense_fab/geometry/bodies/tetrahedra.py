"""A body's surface to tetrahedra, with a report of their quality.

Netgen (Schoeberl 1997) gives the same mesh every time, and soon. fTetWild (Hu et al. 2020) meshes
what Netgen cannot, but never twice the same: what it gives has to be kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.device import MeshSpec
from ...core.errors import MeshingError
from ...core.mesh import Surface, TetMesh
from . import ftetwild, netgen
from .boundary_fit import facet_gaps, fit_boundary
from .child_process import Failure, finished

NETGEN, FTETWILD = "netgen", "ftetwild"
#: Netgen's largest edge for edges of 1 on average; its smallest where the surface is curved.
_LARGEST, _SMALLEST = 0.8, 0.3
#: How far facets may be off the surface before edges get shorter there, in edges.
_GAP = 0.03
#: What is accepted: relative change of volume, smallest dihedral angle (degrees).
_VOLUME, _SHARPEST = 0.02, 1.0
#: Share of the time limit after which Netgen is given up.
_FIRST = 0.1


@dataclass(frozen=True)
class Tetrahedra:
    """A mesh, and the `mesher` that made it: NETGEN, or FTETWILD and `why` not the other."""

    mesh: TetMesh
    mesher: str
    why: str = ""

    @property
    def repeatable(self) -> bool:
        """Whether the same surface gives the same mesh again."""
        return self.mesher == NETGEN


@dataclass(frozen=True)
class MeshQuality:
    """Counts; smallest dihedral angle (degrees); boundary deviation (mm); volume change."""

    tets: int
    nodes: int
    min_dihedral: float
    boundary_deviation: float
    volume_change: float


class _Unusable(MeshingError):
    """A mesher that is not installed as it should be: another one would hide that."""


def tetrahedralise(
    surface: Surface,
    edge_length: float,
    on_step: Callable[[str], None] | None = None,
    time_limit: float = MeshSpec.time_limit,
) -> Tetrahedra:
    """Tets of about `edge_length` mm inside `surface`, smaller where its curvature asks for it: by
    Netgen, and where that makes none that are sound, by fTetWild.

    Raises MeshingError where the edge length does not fit the body, Netgen is not installed as it
    should be, or both fail or take more than `time_limit` s.
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
    try:
        return Tetrahedra(_by_netgen(surface, edge_length, _FIRST * time_limit), NETGEN)
    except _Unusable:
        raise
    except MeshingError as error:
        why = str(error)
        if on_step:
            on_step(f"{why}; fTetWild is tried, which takes longer")
    epsilon = min(1e-3, 0.02 * edge_length / size)
    task = {"edge_length": edge_length, "epsilon": epsilon}
    return Tetrahedra(_tidy(*_run(ftetwild, "fTetWild", surface, task, time_limit)), FTETWILD, why)


def _by_netgen(surface: Surface, edge_length: float, time_limit: float) -> TetMesh:
    """Raises MeshingError where there is none, or none that is sound."""
    task = {"edge_length": _LARGEST * edge_length, "points": np.zeros((0, 3)), "edges": []}
    mesh = _tidy(*_run(netgen, "Netgen", surface, task, time_limit))
    middles, gaps = facet_gaps(mesh, surface)
    wide = gaps > _GAP * edge_length
    if wide.any():  # where facets cut corners, edges as short as that takes
        shrink = np.maximum(np.sqrt(_GAP * edge_length / gaps[wide]), _SMALLEST)
        task |= {"points": middles[wide], "edges": shrink * _LARGEST * edge_length}
        mesh = _tidy(*_run(netgen, "Netgen", surface, task, time_limit))
    mesh = fit_boundary(mesh, surface)
    found = quality(mesh, surface)
    # Written so that what is not a number does not pass.
    if not (abs(found.volume_change) <= _VOLUME and found.boundary_deviation <= edge_length):
        raise MeshingError(
            f"the mesh differs from the body by {100 * found.volume_change:.2g} % of its volume and"
            f" {found.boundary_deviation:.2g} mm"
        )
    if not found.min_dihedral >= _SHARPEST:
        raise MeshingError(f"a tet has an angle of {found.min_dihedral:.2g} degrees")
    return mesh


def _run(
    mesher: ModuleType, name: str, surface: Surface, task: Mapping[str, Any], time_limit: float
) -> tuple[Float, Int]:
    """Nodes and tets of a mesher in a process of its own. Raises MeshingError."""
    failure = Failure(
        MeshingError,
        name,
        "repair the body's surface",
        "use a larger [mesh] edge_length, or raise [mesh] time_limit in device.toml",
    )

    def give(folder: Path) -> None:
        faces = np.asarray(surface.faces, np.int32)
        np.savez(folder / mesher.IN, vertices=surface.vertices, faces=faces, **task)

    with (
        finished(mesher.__name__, give, mesher.OUT, time_limit, failure) as folder,
        np.load(folder / mesher.OUT) as made,
    ):
        if "missing" in made:
            raise _Unusable(
                f"{name} cannot be imported ({made['missing']}), so that the mesh would be another"
                " one than elsewhere; install netgen-mesher and what it needs"
            )
        if "error" in made:
            raise MeshingError(
                f"{name} failed: {made['error']}; repair the body's surface, or use another"
                " [mesh] edge_length"
            )
        return np.asarray(made["nodes"], float), np.asarray(made["tets"], np.int64)


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
