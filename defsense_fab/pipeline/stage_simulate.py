"""Stage 3: every pose, ramp step and mixture to a displacement field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np

from ..core.arrays import Float
from ..core.device import Device
from ..core.errors import SolveError
from ..core.files import write_json
from ..mechanics import tet10
from ..mechanics.material import MODEL, NeoHookean
from ..mechanics.newton import solve_ramp
from ..mechanics.pose import mix
from ..mechanics.tet10 import QuadraticMesh
from .stage_mesh import load_mesh
from .stages import Report, read_json


@dataclass(frozen=True)
class Loading:
    """One solve: weights of poses, the load fractions kept, and whether they are held out."""

    weights: Mapping[str, float]
    fractions: tuple[float, ...]
    held_out: bool

    def state(self, fraction: float) -> str:
        if len(self.weights) == 1 and next(iter(self.weights.values())) == 1.0:
            return f"{next(iter(self.weights))}@{fraction:g}"
        return "+".join(f"{w:g}*{n}" for n, w in self.weights.items())


def loadings(device: Device) -> list[Loading]:
    s = device.states
    return [
        *(Loading({p.name: 1.0}, s.ramp, False) for p in device.poses),
        *(Loading(m, (1.0,), False) for m in s.mixtures),
        *(Loading(m, (1.0,), True) for m in s.held_out),
    ]


def run(device: Device, folder: Path, report: Report) -> None:
    mesh = QuadraticMesh.from_linear(load_mesh(folder))
    material = NeoHookean.from_spec(device.material)
    out = folder / "fields"
    out.mkdir()
    plan = loadings(device)
    conditions = [mix(device.poses, w.weights, device.regions, mesh.nodes) for w in plan]
    index = []
    for i, (loading, condition) in enumerate(zip(plan, conditions, strict=True)):
        label = loading.state(loading.fractions[-1])

        def show(at: float, i: int = i, label: str = label) -> None:
            report((i + at) / len(plan), f"{label}: {100 * at:.0f} %")

        show(0.0)
        results = solve_ramp(mesh, material, condition, loading.fractions, show)
        if not results[-1].converged:
            raise SolveError(
                f"device.toml: poses: {label!r} did not converge beyond {results[-1].amplitude:.0%}"
                " of its amplitude; lower its rotation or translation, enlarge its regions, or"
                " refine [mesh] edge_length"
            )
        for fraction, result in zip(loading.fractions, results, strict=True):
            assert result.u is not None
            name = loading.state(fraction)
            stats = {
                "iterations": result.iterations,
                "steps": result.steps,
                "residual": result.residual,
                "energy": result.energy,
            }
            _write(out / f"{name}.vtu", mesh, result.u, stats)
            index.append({"state": name, "held_out": loading.held_out, **stats})
    write_json(out / "index.json", {"material_model": MODEL, "states": index})


#: Fields are stored to this many decimals of a mm: what threads change in the last digits of a
#: solution must not reach the layout.
_DECIMALS = 5


def _write(path: Path, mesh: QuadraticMesh, u: Float, stats: Mapping[str, float]) -> None:
    u = np.round(u, _DECIMALS)
    meshio.write(
        path,
        meshio.Mesh(
            mesh.nodes,
            [("tetra10", mesh.cells)],
            point_data={"displacement": u, "strain": nodal_strain(mesh, u)},
            field_data={k: np.array([v]) for k, v in stats.items()},
        ),
    )


def nodal_strain(mesh: QuadraticMesh, u: Float) -> Float:
    """Largest principal stretch minus one at the nodes (n,), averaged over their elements."""
    nodes_bary = np.concatenate([np.eye(4), np.eye(4)[tet10.EDGES].mean(axis=1)])
    by = tet10.shape_by_bary(nodes_bary)
    gradient = np.einsum("vnb,mbj->mvnj", by, mesh.bary_gradient)
    F = np.eye(3) + np.einsum("mvnj,mna->mvaj", gradient, u[mesh.cells])
    stretch = np.linalg.svd(F, compute_uv=False)[..., 0]
    total = np.bincount(mesh.cells.ravel(), stretch.ravel(), len(mesh.nodes))
    return np.asarray(total / np.bincount(mesh.cells.ravel(), minlength=len(mesh.nodes)) - 1)


def load_fields(folder: Path) -> tuple[list[str], list[bool], Float]:
    """State names, which are held out, and displacements (s, n, 3) mm."""
    states = read_json(folder / "fields" / "index.json")["states"]
    fields = [
        meshio.read(folder / "fields" / f"{s['state']}.vtu").point_data["displacement"]
        for s in states
    ]
    return [s["state"] for s in states], [s["held_out"] for s in states], np.array(fields, float)
