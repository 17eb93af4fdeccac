"""Solve the poses of a body that its printed traces stiffen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.device.device import Device
from ...core.progress import Report
from ...geometry.channels.cord_channels import Channel
from ...mechanics.elements.material import Material
from ...mechanics.loading.fibers import trace_fibers
from ...mechanics.solver.batch import solve_all
from ...optimization.prediction.as_built import score_channels
from ...optimization.prediction.design_task import DesignTask, load_task
from ...store.build import Build
from ...store.fields import Fields, save_traced_fields
from ...store.forces import ForcesRecord
from .load_cases import list_loadings, prepare_jobs
from .pose_forces import pose_forces, trace_factor
from .stage_simulate import track_jobs

#: Change of signals, relative to the largest, from which the paths are optimized again.
MIN_SIGNAL_CHANGE = 0.05


@dataclass(frozen=True)
class Stiffening:
    """What the stiffness of traces changes.

    Attributes:
        task: The design task with the poses of the stiffened body.
        signals: Largest change of a signal, relative to the largest signal of its trace.
        shapes: Root mean square change of the markers' positions over all states, mm.
        forces: The forces that hold the stiffened body in its poses.
        unsolved: Names of states that could not be solved again; they keep their shapes.
    """

    task: DesignTask
    signals: float
    shapes: float
    forces: ForcesRecord
    unsolved: tuple[str, ...]

    def describe(self) -> str:
        """Return a sentence on the effect."""
        left = f"; unchanged, as not solved: {', '.join(self.unsolved)}" if self.unsolved else ""
        return (
            "the prediction is of the body with its traces: their stiffness changes signals by up"
            f" to {self.signals:.1%} of the largest, and shapes by {self.shapes:.2g} mm (root mean"
            f" square); poses take up to {self.forces.traces - 1:.1%} more work{left}"
        )


def stiffen(
    device: Device,
    build: Build,
    task: DesignTask,
    channels: tuple[Channel, ...],
    report: Report,
) -> Stiffening:
    """Solve all states again with the traces in the body, and use them from now on.

    The fields are saved with the layout, and replace those of `build`.

    Args:
        device: The device.
        build: Its build, with the poses.
        task: Its design task.
        channels: Lines of the traces.
        report: Receives the completed fraction and a message.
    """
    mesh, plain = build.quadratic_mesh, build.plain_fields
    plan, jobs, _ = prepare_jobs(device, mesh, list_loadings(device))
    simulated = device.simulated_material.young_modulus
    fibers = trace_fibers(device, [c.sensing for c in channels], simulated)
    stiff = [replace(j, conditions=replace(j.conditions, fibers=fibers)) for j in jobs]
    material = Material.from_spec(device.simulated_material)
    results = solve_all(mesh, material, stiff, track_jobs(plan, report))
    solved = {
        loading.state(fraction): result.u
        for loading, found in zip(plan, results, strict=True)
        for fraction, result in zip(loading.fractions, found, strict=False)
        if result.converged and result.u is not None
    }
    unsolved = tuple(name for name in plain.names if name not in solved)
    moved = [solved.get(name, u) for name, u in zip(plain.names, plain.displacements, strict=True)]
    build.fields = save_traced_fields(build.folder, mesh, build.field_index, np.array(moved))
    stiffened = load_task(device, build).with_decoder(task.everything.decoder)
    before, after = (score_channels(t, channels).signals for t in (task, stiffened))
    signals = np.abs(after - before).max(axis=0) / np.maximum(np.abs(before).max(axis=0), 1e-12)
    change = stiffened.everything.markers - task.everything.markers
    shapes = np.sqrt(((change**2).sum(axis=2) @ task.everything.marker_weights).mean())
    forces = pose_forces(device, mesh, build.fields, fibers, unsolved)
    factor = trace_factor(pose_forces(device, mesh, plain), forces)
    forces = replace(forces, traces=factor)
    return Stiffening(stiffened, float(signals.max()), float(shapes), forces, unsolved)


def use_plain_fields(build: Build) -> Fields:
    """Return the fields of the body without traces, and use them."""
    build.fields = build.plain_fields
    return build.fields
