"""What a device asks to be solved: poses with their ramps, mixtures, held-out mixtures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.device import Device
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.constraint_check import check_constraints, narrow
from ...mechanics.loading.pose import mix
from ...mechanics.solver.batch import Job


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
    """Every solve that the device asks for: ramps of its poses, mixtures, held-out mixtures."""
    s = device.states
    return [
        *(Loading({p.name: 1.0}, s.ramp, False) for p in device.poses),
        *(Loading(m, (1.0,), False) for m in s.mixtures),
        *(Loading(m, (1.0,), True) for m in s.held_out),
    ]


def jobs(
    device: Device, mesh: QuadraticMesh, plan: Sequence[Loading]
) -> tuple[list[Job], list[str]]:
    """What to solve, and warnings. Raises DeviceError where a pose does not hold the body."""
    out, warnings = [], []
    for loading in plan:
        conditions = mix(
            device.poses, loading.weights, device.regions, mesh, device.material.density
        )
        warnings += check_constraints(mesh, conditions, loading.state(loading.fractions[-1]))
        for name in sorted(
            {n for p in device.poses if loading.weights.get(p.name) for n in p.fixed}
        ):
            held = np.flatnonzero(device.regions[name].contains(mesh.nodes))
            warnings += narrow(mesh, held, name)
        out.append(Job(conditions, loading.fractions))
    return out, list(dict.fromkeys(warnings))
