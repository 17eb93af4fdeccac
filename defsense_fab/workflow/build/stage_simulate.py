"""Stage 3: solve the displacement field of every pose, ramp step and mixture."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.device.material_table import unusual_properties
from ...core.errors import SolveError
from ...core.progress import describe_duration
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.solver.batch import Solve, solve_all
from ...mechanics.solver.fields import locate_largest_strain
from ...mechanics.solver.linear_solver import solver_name
from ...mechanics.solver.load_stepping import Equilibrium, Status
from ...mechanics.solver.solved_jobs import SolvedJobs
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
from .load_cases import Loading, list_loadings, prepare_jobs
from .stages import CODE_VERSION, Report, installed_versions

#: Jobs that end within this time were solved before; the time left is estimated after this time, s.
_RESUMED_WITHIN_S, _ESTIMATED_AFTER_S = 0.3, 3.0
# Dihedral angle of a tetrahedron below which it is a sliver, degrees.
_SLIVER_ANGLE_DEG = 2.0
_UNREACHED = "not-reached"


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
    material = Material.from_spec(device.simulated_material)
    (folder / FOLDER).mkdir()
    for stale in (device.source / _UNREACHED).glob("*@*.vtu"):
        stale.unlink()
    doubts = unusual_properties(device.material)
    for line in doubts:
        report(0.0, line)
    plan, jobs, job_warnings = prepare_jobs(device, mesh, list_loadings(device))
    warnings = [*doubts, *job_warnings]
    angle = build.mesh_record.min_dihedral
    if angle < _SLIVER_ANGLE_DEG:
        warnings.append(
            f"the mesh has a sliver with an angle of {angle:.1f} degrees, where strains are"
            " unreliable. Use another [mesh] edge_length, or repair thin folds of the body"
        )
    on_step = track_jobs(plan, report)
    version = ("simulate", CODE_VERSION, installed_versions()["simulate"])
    kept = SolvedJobs(version, partial(report, 0.0))
    solutions = kept.solve(solve, mesh, material, jobs, on_step)
    _save_fields(device, build, list(zip(plan, solutions, strict=True)), warnings)


def _save_fields(
    device: Device,
    build: Build,
    solutions: Sequence[tuple[Loading, list[Equilibrium]]],
    warnings: list[str],
) -> None:
    """Save the field of each state, and the index of all.

    Raises:
        SolveError: A pose or a requested mixture did not converge.
    """
    mesh, folder = build.quadratic_mesh, build.folder
    states: list[StateRecord] = []
    fields: list[tuple[Float, Float]] = []
    for loading, results in solutions:
        if not loading.optional:
            _refuse_unreached(device, mesh, loading, results[-1])
        for fraction, result in zip(loading.fractions, results, strict=not loading.optional):
            name = loading.state(fraction)
            if loading.optional and not (result.converged and result.problem is None):
                reason = result.problem or "it did not converge"
                warnings.append(f"the proposed state {name} is left out: {reason}")
                continue
            assert result.u is not None
            stats = {k: v for k, v in asdict(result.statistics).items() if k != "seconds"}
            fields.append(save_field(field_path(folder, name), mesh, result.u, stats))
            weights = {pose: w * fraction for pose, w in loading.weights.items()}
            states.append(StateRecord(name, weights, loading.held_out, result.status, **stats))
            if result.problem:
                warnings.append(f"pose {name}: {result.problem}")
    build.field_index = FieldIndex(
        Material.from_spec(device.material).title, solver_name(), tuple(warnings), tuple(states)
    )
    save_index(folder, build.field_index)
    build.fields = build.plain_fields = Fields.of(states, fields)


def track_jobs(plan: Sequence[Loading], report: Report) -> Callable[[int, float], None]:
    """Return a callback that reports the progress of jobs, which run in several threads, and the
    estimated time left.
    """
    fractions = [0.0] * len(plan)
    lock = threading.Lock()
    started_at, at_start = time.monotonic(), 0.0

    def show(job: int, fraction: float) -> None:
        nonlocal at_start
        with lock:
            seconds = time.monotonic() - started_at
            if fraction == 1.0 and not fractions[job] and seconds < _RESUMED_WITHIN_S:
                at_start += 1.0
            fractions[job] = fraction
            done = sum(fractions)
            message = f"{plan[job].label}: {100 * fraction:.0f} %"
            if seconds > _ESTIMATED_AFTER_S and at_start < done < len(plan):
                left = seconds / (done - at_start) * (len(plan) - done)
                message += f", about {describe_duration(left)} left"
            report(done / len(plan), message)

    return show


def _refuse_unreached(
    device: Device, mesh: QuadraticMesh, loading: Loading, last: Equilibrium
) -> None:
    """Raise SolveError for a pose that did not converge, and save its last field.

    The field is saved in the folder `not-reached` of the device.
    """
    if last.converged:
        return
    is_over = last.status is Status.OVER_BUDGET
    effort = f" within its budget, after {last.statistics.factors} matrices," if is_over else ""
    strain, point, region, place = None, None, None, ""
    if last.last_state is not None and last.amplitude > 0:
        strain, point = locate_largest_strain(mesh, last.last_state.u)
        region = _nearest_region(device, loading, mesh, point)
        at = ", ".join(f"{x:.3g}" for x in point)
        place = f"; its largest strain, {strain:.0%}, is at ({at}) mm, next to {region!r}"
    state, path, saved = loading.label, None, ""
    if last.last_state is not None and last.amplitude > 0:
        folder = device.source / _UNREACHED
        folder.mkdir(exist_ok=True)
        path = folder / f"{state_file(state.split('@')[0])}@{last.amplitude:.3g}.vtu"
        save_field(path, mesh, last.last_state.u, {})
        saved = f" (the body at that amplitude: {path})"
    raise SolveError(
        f"{state!r} did not converge{effort} beyond {last.amplitude:.0%} of its amplitude{place}"
        f"{saved}",
        code="pose-over-budget" if is_over else "pose-not-reached",
        where="device.toml: poses",
        action=f"Reduce its movement or load to less than {last.amplitude:.0%}, enlarge"
        f" {repr(region) if region else 'its regions'}, or refine the mesh. States that were"
        " solved are kept",
        state=state,
        amplitude=last.amplitude,
        path=path,
        region=region,
        strain=strain,
        point=point,
    )


def _nearest_region(device: Device, loading: Loading, mesh: QuadraticMesh, point: Float) -> str:
    """Return the name of the region of a loading's poses that is nearest to a point (3,) mm."""
    poses = [p for p in device.poses if loading.weights.get(p.name)]
    names = {n for p in poses for n in (*p.fixed, *(h.region for h in p.handles))}

    def distance(name: str) -> float:
        nodes = mesh.nodes[device.regions[name].contains(mesh.nodes)]
        return float(np.linalg.norm(nodes - point, axis=1).min(initial=np.inf))

    return min(sorted(names), key=distance)
