"""Stage 3: every pose, ramp step and mixture to a displacement field."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import meshio
import numpy as np

from ...core.arrays import Float
from ...core.device import Device
from ...core.errors import SolveError
from ...core.files import write_json
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.solver import fields
from ...mechanics.solver.batch import solve_all
from ...mechanics.solver.linear_solver import solver_name
from ...mechanics.solver.load_stepping import Equilibrium
from .load_cases import Loading, jobs, loadings
from .stage_mesh import load_mesh
from .stages import Report, read_json

#: Tets with a smaller dihedral angle (degrees) are warned of.
SLIVER = 2.0


def run(device: Device, folder: Path, report: Report) -> None:
    mesh = QuadraticMesh.from_linear(load_mesh(folder))
    material = Material.from_spec(device.material)
    out = folder / "fields"
    out.mkdir()
    for stale in (device.source / "not-reached").glob("*@*.vtu"):
        stale.unlink()
    plan = loadings(device)
    todo, warnings = jobs(device, mesh, plan)
    angle = read_json(folder / "mesh.json")["min_dihedral"]
    if angle < SLIVER:
        warnings.append(
            f"the mesh has a sliver with an angle of {angle:.1f} degrees, where strains are not to"
            " be trusted; use another [mesh] edge_length, or repair thin folds of the body"
        )
    reached = [0.0] * len(plan)
    lock = threading.Lock()

    def show(job: int, at: float) -> None:
        with lock:
            reached[job] = at
            label = plan[job].state(plan[job].fractions[-1])
            report(sum(reached) / len(plan), f"{label}: {100 * at:.0f} %")

    index = []
    for loading, results in zip(plan, solve_all(mesh, material, todo, show), strict=True):
        _refuse_unreached(device, mesh, loading, results[-1])
        for fraction, result in zip(loading.fractions, results, strict=True):
            assert result.u is not None
            name = loading.state(fraction)
            stats = {k: v for k, v in asdict(result.statistics).items() if k != "seconds"}
            write_field(out / f"{name}.vtu", mesh, result.u, stats)
            index.append(
                {"state": name, "held_out": loading.held_out, "status": result.status, **stats}
            )
            if result.problem:
                warnings.append(f"pose {name}: {result.problem}")
    write_json(
        out / "index.json",
        {
            "material_model": material.title,
            "solver": solver_name(),
            "warnings": warnings,
            "states": index,
        },
    )


def _refuse_unreached(
    device: Device, mesh: QuadraticMesh, loading: Loading, last: Equilibrium
) -> None:
    """Raise SolveError for a pose that the body cannot take; its furthest field is left beside."""
    if last.converged:
        return
    label = loading.state(loading.fractions[-1])
    offered = ""
    if last.largest is not None and last.amplitude > 0:
        folder = device.source / "not-reached"
        folder.mkdir(exist_ok=True)
        path = folder / f"{label.split('@')[0]}@{last.amplitude:.3g}.vtu"
        write_field(path, mesh, last.largest.u, {})
        offered = f" (the body at that amplitude: {path})"
    raise SolveError(
        f"device.toml: poses: {label!r} did not converge beyond {last.amplitude:.0%} of its"
        f" amplitude{offered}; lower its movement or load, enlarge its regions, or refine the"
        " mesh"
    )


#: Fields are stored to this many decimals of a mm: what threads change in the last digits of a
#: solution must not reach the layout.
_DECIMALS = 5


def write_field(path: Path, mesh: QuadraticMesh, u: Float, stats: Mapping[str, float]) -> None:
    """One VTU: displacement, deformation gradient (row by row) and stretches at the nodes."""
    u = np.round(u, _DECIMALS)
    F = fields.deformation_gradient_at_nodes(mesh, u)
    stretches = fields.principal_stretches(F)
    meshio.write(
        path,
        meshio.Mesh(
            mesh.nodes,
            [("tetra10", mesh.cells)],
            point_data={
                "displacement": u,
                "strain": stretches[:, 0] - 1,
                "principal_stretches": stretches,
                "deformation_gradient": F.reshape(-1, 9),
            },
            field_data={k: np.array([v]) for k, v in stats.items()},
        ),
    )


def load_fields(folder: Path) -> tuple[list[str], list[bool], Float]:
    """State names, which are held out, and displacements (s, n, 3) mm."""
    states = read_json(folder / "fields" / "index.json")["states"]
    found = [
        meshio.read(folder / "fields" / f"{s['state']}.vtu").point_data["displacement"]
        for s in states
    ]
    return [s["state"] for s in states], [s["held_out"] for s in states], np.array(found, float)
