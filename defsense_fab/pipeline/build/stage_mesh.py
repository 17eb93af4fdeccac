"""Stage 2: tetrahedra and the tags of the regions."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from ...core.device import Device
from ...core.errors import DeviceError
from ...core.files import write_json
from ...core.mesh import TetMesh
from ...geometry.bodies.region_conforming import conform
from ...geometry.bodies.tetrahedra import quality, tetrahedralise
from . import mesh_density, mesh_store
from .stage_body import load_surface
from .stages import Report


def run(device: Device, folder: Path, report: Report) -> None:
    surface = load_surface(folder)

    def make(edge_length: float) -> TetMesh:
        made = mesh_store.recall(surface, edge_length)
        if made is None:
            made = tetrahedralise(surface, edge_length, lambda m: report(0.3, m))
            mesh_store.remember(surface, edge_length, made)
        return conform(made, list(device.regions.values()))

    density: dict[str, Any] = {"edge_length": device.mesh.edge_length}
    if device.mesh.edge_length is not None:
        mesh = make(device.mesh.edge_length)
    elif not device.poses:  # looking for poses: what they will need is not known yet
        mesh = make(mesh_density.coarse_edge(surface) / mesh_density.RATIO)
    else:
        assert device.mesh.accuracy is not None
        choice = mesh_density.choose(device, surface, device.mesh.accuracy, make, report)
        mesh = choice.taken.mesh
        density = {
            "edge_length": choice.taken.edge_length,
            "accuracy": {
                "asked": device.mesh.accuracy,
                "reached": _known(choice.taken.error),
                "tried": [
                    {
                        "edge_length": t.edge_length,
                        "tets": len(t.mesh.tets),
                        "error": _known(t.error),
                    }
                    for t in choice.trials
                ],
            },
        }
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
    write_json(
        folder / "mesh.json", {"hash": mesh.digest, **density, **asdict(quality(mesh, surface))}
    )


def _known(error: float) -> float | None:
    return error if np.isfinite(error) else None


def load_mesh(folder: Path) -> TetMesh:
    data = meshio.read(folder / "mesh.vtu")
    return TetMesh(np.asarray(data.points, float), data.cells_dict["tetra"].astype(np.int64))
