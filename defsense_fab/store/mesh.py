"""Results of the stage "mesh": the tetrahedra and their quality."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import meshio
import numpy as np
from meshio import vtu

from ..core.arrays import Bool
from ..core.device.build_folder import BUILD_AGAIN
from ..core.errors import StorageError
from ..core.mesh import TetMesh
from ..core.storage import typed_json
from ..geometry.bodies.meshing.meshers import FTETWILD
from ..geometry.bodies.meshing.tetrahedra import MeshedSurface

FILE, RECORD = "mesh.vtu", "mesh.json"
_REGION = "region:"


@dataclass(frozen=True)
class DensityTrial:
    """A mesh that was tried to reach an accuracy.

    Attributes:
        edge_length: Edge length, mm.
        tets: Number of tetrahedra.
        error: Largest relative error of the signals; None if it was not measured.
    """

    edge_length: float
    tets: int
    error: float | None


@dataclass(frozen=True)
class Accuracy:
    """How the edge length was chosen.

    Attributes:
        asked: Requested relative error of signals.
        reached: Estimated relative error; None if it is unknown.
        tried: The meshes that were tried.
    """

    asked: float
    reached: float | None
    tried: tuple[DensityTrial, ...]


@dataclass(frozen=True)
class MeshRecord:
    """The content of `mesh.json`.

    Attributes:
        hash: Hash of the mesh.
        edge_length: Edge length, mm; None before poses are known.
        tets: Number of tetrahedra.
        nodes: Number of nodes.
        min_dihedral: Smallest dihedral angle, degrees.
        boundary_deviation: Largest distance of the boundary from the body's surface, mm.
        volume_change: Relative change of the volume.
        accuracy: How the edge length was chosen, if it was not given.
        mesher: The mesher; builds that do not state it used fTetWild.
        note: What a reader of the report should know about the mesh.
        way: How the mesh was made.
        tried: Ways that failed before it.
        surface: The surface that was meshed, if it is not the body's own.
    """

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
    """Write `mesh.vtu`, with the tags (n,) of the nodes in each region, and `mesh.json`."""
    meshio.write(
        folder / FILE,
        meshio.Mesh(
            mesh.nodes,
            [("tetra", mesh.tets)],
            point_data={f"{_REGION}{n}": t.astype(np.int8) for n, t in regions.items()},
        ),
    )
    typed_json.save(folder / RECORD, record)


def read_vtu(path: Path) -> Any:
    """Return the meshio.Mesh in a file.

    `meshio.read` is not used, as it ends the process on damaged files.

    Raises:
        StorageError: The file is missing or damaged.
    """
    try:
        return vtu.read(str(path))
    except OSError as error:
        raise StorageError(
            f"cannot be read: {error.strerror or error}",
            code="file-unreadable",
            where=path,
            action=BUILD_AGAIN,
        ) from None
    except Exception as error:  # meshio's parsers raise errors of many classes
        reason = " ".join(str(error).split()) or "truncated"
        raise StorageError(
            f"is damaged ({reason})", code="file-damaged", where=path, action=BUILD_AGAIN
        ) from None


def load_mesh(folder: Path) -> TetMesh:
    """Return the tetrahedra of a build, mm, rest frame. Raises StorageError."""
    data = read_vtu(folder / FILE)
    if "tetra" not in data.cells_dict:
        raise StorageError(
            "has no tetrahedra", code="file-damaged", where=folder / FILE, action=BUILD_AGAIN
        )
    return TetMesh(np.asarray(data.points, float), data.cells_dict["tetra"].astype(np.int64))


def load_region_nodes(folder: Path) -> dict[str, Bool]:
    """Return which nodes (n,) each region contained when the mesh was made, by its name."""
    data = read_vtu(folder / FILE).point_data
    return {
        name.removeprefix(_REGION): np.asarray(tags, bool)
        for name, tags in data.items()
        if name.startswith(_REGION)
    }


def load_mesh_record(folder: Path) -> MeshRecord:
    """Return the record of a build's mesh. Raises StorageError."""
    return typed_json.load(folder / RECORD, MeshRecord, BUILD_AGAIN)
