"""What the mesh stage leaves: the tetrahedra, and how good they are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import meshio
import numpy as np

from ..core.arrays import Bool
from ..core.device.build_folder import BUILD_AGAIN
from ..core.errors import StorageError
from ..core.mesh import TetMesh
from ..core.storage import typed_json
from ..geometry.bodies.meshing.meshers import FTETWILD
from ..geometry.bodies.meshing.tetrahedra import MeshedSurface
from .vtu_file import read_vtu

FILE, RECORD = "mesh.vtu", "mesh.json"
_REGION = "region:"


@dataclass(frozen=True)
class DensityTrial:
    """An edge length (mm) that was tried for an accuracy, its number of tets, the largest relative
    error of signals that it gave; None where it was not measured."""

    edge_length: float
    tets: int
    error: float | None


@dataclass(frozen=True)
class Accuracy:
    """The relative error of signals that was asked for and reached, and the trials."""

    asked: float
    reached: float | None
    tried: tuple[DensityTrial, ...]


@dataclass(frozen=True)
class MeshRecord:
    """`mesh.json`: hash of the mesh; edge length (mm), None before poses are known; counts;
    smallest dihedral angle (degrees); boundary deviation (mm); relative change of volume; which
    `mesher` made it (that of all builds before it was told), and a `note` on that, or none; the
    `way` it was made, sentences on those `tried` before it in vain, and the `surface` that was
    meshed where it was not the body's own."""

    SCHEMA: ClassVar[int] = 1

    hash: str
    edge_length: float | None
    tets: int
    nodes: int
    min_dihedral: float
    boundary_deviation: float
    volume_change: float
    accuracy: Accuracy | None = None
    mesher: str = FTETWILD
    note: str = ""
    way: str = ""
    tried: tuple[str, ...] = ()
    surface: MeshedSurface | None = None


def save_mesh(folder: Path, mesh: TetMesh, regions: dict[str, Bool], record: MeshRecord) -> None:
    """`mesh.vtu` with the nodes (n,) of each region, and `mesh.json`."""
    meshio.write(
        folder / FILE,
        meshio.Mesh(
            mesh.nodes,
            [("tetra", mesh.tets)],
            point_data={f"{_REGION}{n}": t.astype(np.int8) for n, t in regions.items()},
        ),
    )
    typed_json.save(folder / RECORD, record)


def load_mesh(folder: Path) -> TetMesh:
    """The tets of a build, nodes in mm in the rest frame. Raises StorageError."""
    data = read_vtu(folder / FILE)
    if "tetra" not in data.cells_dict:
        raise StorageError(f"{folder / FILE}: has no tetrahedra; {BUILD_AGAIN}")
    return TetMesh(np.asarray(data.points, float), data.cells_dict["tetra"].astype(np.int64))


def load_region_nodes(folder: Path) -> dict[str, Bool]:
    """Which nodes (n,) the regions had for which the mesh was made, by name."""
    data = read_vtu(folder / FILE).point_data
    return {
        name.removeprefix(_REGION): np.asarray(tags, bool)
        for name, tags in data.items()
        if name.startswith(_REGION)
    }


def load_mesh_record(folder: Path) -> MeshRecord:
    """Raises StorageError."""
    return typed_json.load(folder / RECORD, MeshRecord, BUILD_AGAIN)
