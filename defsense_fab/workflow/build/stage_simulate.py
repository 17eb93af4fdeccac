"""Stage 3: every pose, ramp step and mixture to a displacement field."""

from __future__ import annotations

import threading
from dataclasses import asdict

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.device.material_table import unusual_properties
from ...core.errors import SolveError
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.solver.batch import solve_all
from ...mechanics.solver.linear_solver import solver_name
from ...mechanics.solver.load_stepping import Equilibrium
from ...store.build import Build
from ...store.fields import (
    FOLDER,
    FieldIndex,
    Fields,
    StateRecord,
    field_path,
    save_field,
    save_index,
    state_file,
)
from .load_cases import Loading, jobs, loadings
from .stages import Report, Solve

#: Tets with a smaller dihedral angle (degrees) are warned of.
SLIVER = 2.0


def run(device: Device, build: Build, report: Report, solve: Solve = solve_all) -> None:
    """Solve every state, and save its field.

    Args:
        device: The device.
        build: Results of the earlier stages.
        report: Receives the completed fraction and a message.
        solve: `solve_all`, or a function that does the same elsewhere.

    Raises:
        SolveError: A pose or a requested mixture did not converge.
    """
    mesh, folder = build.quadratic_mesh, build.folder
    material = Material.from_spec(device.material)
    (folder / FOLDER).mkdir()
    for stale in (device.source / "not-reached").glob("*@*.vtu"):
        stale.unlink()
    questions = unusual_properties(device.material)
    for line in questions:
        report(0.0, line)
    plan, todo, warnings = jobs(device, mesh, loadings(device))
    warnings = [*questions, *warnings]
    angle = build.mesh_record.min_dihedral
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

    states: list[StateRecord] = []
    fields: list[tuple[Float, Float]] = []
    for loading, results in zip(plan, solve(mesh, material, todo, show), strict=True):
        if not loading.optional:
            _refuse_unreached(device, mesh, loading, results[-1])
        for fraction, result in zip(loading.fractions, results, strict=not loading.optional):
            name = loading.state(fraction)
            if loading.optional and not (result.converged and result.problem is None):
                why = result.problem or "it did not converge"
                warnings.append(f"the proposed state {name} is left out: {why}")
                continue
            assert result.u is not None
            stats = {k: v for k, v in asdict(result.statistics).items() if k != "seconds"}
            fields.append(save_field(field_path(folder, name), mesh, result.u, stats))
            weights = {pose: w * fraction for pose, w in loading.weights.items()}
            states.append(StateRecord(name, weights, loading.held_out, result.status, **stats))
            if result.problem:
                warnings.append(f"pose {name}: {result.problem}")
    build.field_index = FieldIndex(material.title, solver_name(), tuple(warnings), tuple(states))
    save_index(folder, build.field_index)
    build.fields = Fields.of(states, fields)


def _refuse_unreached(
    device: Device, mesh: QuadraticMesh, loading: Loading, last: Equilibrium
) -> None:
    """Raise SolveError for a pose that the body cannot take; its furthest field is left beside."""
    if last.converged:
        return
    label = loading.state(loading.fractions[-1])
    offered = ""
    if last.last_state is not None and last.amplitude > 0:
        folder = device.source / "not-reached"
        folder.mkdir(exist_ok=True)
        path = folder / f"{state_file(label.split('@')[0])}@{last.amplitude:.3g}.vtu"
        save_field(path, mesh, last.last_state.u, {})
        offered = f" (the body at that amplitude: {path})"
    raise SolveError(
        f"device.toml: poses: {label!r} did not converge beyond {last.amplitude:.0%} of its"
        f" amplitude{offered}; lower its movement or load, enlarge its regions, or refine the"
        " mesh"
    )
