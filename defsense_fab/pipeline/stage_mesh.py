"""Stage 2: tetrahedra and the tags of the regions."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import meshio
import numpy as np

from ..core.device import Device
from ..core.errors import DeviceError
from ..core.files import write_json
from ..core.mesh import TetMesh
from ..geometry.tetrahedra import quality, tetrahedralise
from . import mesh_store
from .stage_body import load_surface
from .stages import Report


def run(device: Device, folder: Path, report: Report) -> None:
    surface = load_surface(folder)
    mesh = mesh_store.recall(surface, device.edge_length)
    if mesh is None:
        mesh = tetrahedralise(surface, device.edge_length, lambda m: report(0.3, m))
        mesh_store.remember(surface, device.edge_length, mesh)
    report(0.8, "measuring quality")
    tags = {name: shape.contains(mesh.nodes) for name, shape in device.regions.items()}
    for name, inside in tags.items():
        if not inside.any():
            raise DeviceError(
                f"device.toml: regions.{name}: holds no nodes of the mesh; move or enlarge it, or"
                " use a smaller [mesh] edge_length"
            )
    meshio.write(
        folder / "mesh.vtu",
        meshio.Mesh(
            mesh.nodes,
            [("tetra", mesh.tets)],
            point_data={f"region:{n}": t.astype(np.int8) for n, t in tags.items()},
        ),
    )
    write_json(folder / "mesh.json", {"hash": mesh.digest, **asdict(quality(mesh, surface))})


def load_mesh(folder: Path) -> TetMesh:
    data = meshio.read(folder / "mesh.vtu")
    return TetMesh(np.asarray(data.points, float), data.cells_dict["tetra"].astype(np.int64))
