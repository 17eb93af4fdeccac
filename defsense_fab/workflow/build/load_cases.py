"""What a device asks to be solved: poses with their ramps, mixtures, held-out mixtures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.device.device import Device
from ...core.device.states import LoadingPath, loading_path
from ...core.errors import DeviceError
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.constraint_check import check_constraints, warn_small_region
from ...mechanics.loading.pose import mix_poses
from ...mechanics.solver.batch import Job


@dataclass(frozen=True)
class Loading:
    """One solve: weights of poses, the load fractions kept, whether they are held out, and whether
    it may be left out where it cannot be solved."""

    weights: Mapping[str, float]
    fractions: tuple[float, ...]
    held_out: bool
    optional: bool = False

    def state(self, fraction: float) -> str:
        """Its name at a fraction."""
        if len(self.weights) == 1 and next(iter(self.weights.values())) == 1.0:
            return f"{next(iter(self.weights))}@{fraction:g}"
        return "+".join(f"{w * fraction:g}*{n}" for n, w in self.weights.items())


def loadings(device: Device) -> list[Loading]:
    """Every solve that the device asks for: ramps of its poses, mixtures, held-out mixtures."""
    s = device.states
    return [
        *(Loading({p.name: 1.0}, s.ramp, False) for p in device.poses),
        *_along(s.mixtures, False, not s.given),
        *_along(s.held_out, True, not s.given),
    ]


def _along(
    mixtures: Sequence[Mapping[str, float]], held_out: bool, optional: bool
) -> list[Loading]:
    """Mixtures of which one is a part of another lie on one path of loading."""
    paths: dict[LoadingPath, list[tuple[float, Mapping[str, float]]]] = {}
    for m in mixtures:
        path, at = loading_path(m)
        paths.setdefault(path, []).append((at, m))
    out = []
    for same in paths.values():
        whole, weights = max(same, key=lambda found: found[0])
        fractions = tuple(sorted(at / whole for at, _ in same))
        out.append(Loading(weights, fractions, held_out, optional))
    return out


def jobs(
    device: Device, mesh: QuadraticMesh, plan: Sequence[Loading]
) -> tuple[list[Loading], list[Job], list[str]]:
    """What to solve of a plan, how, and warnings. Raises DeviceError where a pose does not hold the
    body, or poses that do not go together are to be mixed."""
    kept, out, warnings = [], [], []
    for loading in plan:
        try:
            conditions = mix_poses(
                device.poses, loading.weights, device.regions, mesh, device.material.density
            )
            said = check_constraints(mesh, conditions, loading.state(loading.fractions[-1]))
        except DeviceError as error:
            if not loading.optional:
                raise
            warnings.append(f"{' and '.join(loading.weights)} are not mixed: {error}")
            continue
        kept.append(loading)
        warnings += said
        for name in sorted(
            {n for p in device.poses if loading.weights.get(p.name) for n in p.fixed}
        ):
            held = np.flatnonzero(device.regions[name].contains(mesh.nodes))
            warnings += warn_small_region(mesh, held, name)
        out.append(Job(conditions, loading.fractions, loading.state(loading.fractions[-1])))
    return kept, out, list(dict.fromkeys(warnings))
