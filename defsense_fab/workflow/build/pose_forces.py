"""Find the forces that hold a device in its poses, from the solved fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.fibers import Fibers
from ...mechanics.loading.pose import mix_poses
from ...mechanics.solver.reactions import Reaction, find_reactions
from ...store.fields import Fields
from ...store.forces import ForcesRecord, HeldRecord, PoseForces
from .load_cases import Loading, list_loadings

_DIGITS = 6  # of stored numbers: displacements have five decimals


def pose_forces(
    device: Device,
    mesh: QuadraticMesh,
    fields: Fields,
    fibers: Fibers | None = None,
    without: Sequence[str] = (),
) -> ForcesRecord:
    """Return the forces of each pose in the state of its ramp where they are largest.

    Args:
        device: The device.
        mesh: The mesh of the fields.
        fields: The solved states.
        fibers: The printed traces in the body, with which the states were solved.
        without: Names of states that were not solved with the traces, and are left out.
    """
    simulated = device.simulated_material
    material = Material.from_spec(simulated)
    scale = device.material.young_modulus / simulated.young_modulus
    solved = dict(zip(fields.names, fields.displacements, strict=True))
    solved = {name: u for name, u in solved.items() if name not in without}
    poses = []
    for pose in device.poses:
        loading = next(p for p in list_loadings(device) if p.weights == {pose.name: 1.0})
        conditions = mix_poses(
            device.poses, loading.weights, device.regions, mesh, device.material.density
        )
        conditions = replace(conditions, fibers=fibers)
        states, at, before = [], 0.0, np.zeros_like(mesh.nodes)
        for fraction, u in _ramp(loading, solved):
            reactions = find_reactions(
                mesh, material, conditions, fraction, (u, before), fraction - at
            )
            states.append(_record(pose.name, loading.state(fraction), reactions, scale))
            at, before = fraction, u
        if states:
            poses.append(max(states, key=lambda s: s.push))
    return ForcesRecord(tuple(poses))


def trace_factor(plain: ForcesRecord, traced: ForcesRecord) -> float:
    """Return the largest factor by which traces increase the work of a pose; 1 if none is done."""
    before = {p.pose: p.power for p in plain.poses}
    factors = [p.power / before[p.pose] for p in traced.poses if before.get(p.pose, 0.0) > 0]
    return _round(max(factors, default=1.0))


def _ramp(loading: Loading, solved: Mapping[str, Float]) -> list[tuple[float, Float]]:
    """Return the solved fractions of a path, increasing, with their displacements (n, 3) mm."""
    states = [(f, solved.get(loading.state(f))) for f in loading.fractions]
    return [(f, u) for f, u in states if u is not None]


def _record(pose: str, state: str, reactions: Sequence[Reaction], scale: float) -> PoseForces:
    held = tuple(
        HeldRecord(
            r.place,
            _round(scale * r.push),
            np.array([_round(v) for v in scale * r.force]),
            np.array([_round(v) for v in scale * r.moment]),
        )
        for r in reactions
    )
    return PoseForces(pose, state, _round(scale * sum(r.power for r in reactions)), held)


def _round(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
