"""The load cases of a device: ramps of its poses, mixtures, and held-out mixtures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.device.device import Device, StatesSpec
from ...core.device.states import LoadingPath, loading_path
from ...core.errors import DeviceError
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.constraint_check import check_constraints, warn_small_region
from ...mechanics.loading.pose import mix_poses
from ...mechanics.solver.batch import STATE_BUDGET, Job
from ...store.fields import StateRecord

#: Factorizations after which a proposed mixture is left out.
PROPOSED_BUDGET = 40
#: Part of a warning between the poses that are not mixed, and the reason.
NOT_MIXED = " are not mixed: "


@dataclass(frozen=True)
class Loading:
    """One path of loading, which is one solve.

    Attributes:
        weights: Weights of the poses at the end of the path, by name.
        fractions: Fractions of the path at which states are kept.
        held_out: Whether these states are held out of the design.
        optional: Whether states that cannot be solved are left out instead of refused.
    """

    weights: Mapping[str, float]
    fractions: tuple[float, ...]
    held_out: bool
    optional: bool = False

    def state(self, fraction: float) -> str:
        """Return the name of the state at a fraction, as in "bend@0.5" or "0.5*bend+1*twist"."""
        if len(self.weights) == 1 and next(iter(self.weights.values())) == 1.0:
            return f"{next(iter(self.weights))}@{fraction:g}"
        return "+".join(f"{w * fraction:g}*{n}" for n, w in self.weights.items())

    @property
    def label(self) -> str:
        """Name of the state at the end of the path."""
        return self.state(self.fractions[-1])


def list_loadings(device: Device) -> list[Loading]:
    """Return all loadings of a device: ramps of its poses, mixtures, and held-out mixtures."""
    s = device.states
    return [
        *(Loading({p.name: 1.0}, s.ramp, False) for p in device.poses),
        *_mixture_loadings(s.mixtures, False, not s.mixtures_given),
        *_mixture_loadings(s.held_out, True, not s.held_out_given),
    ]


def _mixture_loadings(
    mixtures: Sequence[Mapping[str, float]], held_out: bool, optional: bool
) -> list[Loading]:
    """Return loadings for mixtures; proportional mixtures share one."""
    paths: dict[LoadingPath, list[tuple[float, Mapping[str, float]]]] = {}
    for m in mixtures:
        path, amount = loading_path(m)
        paths.setdefault(path, []).append((amount, m))
    loadings = []
    for proportional in paths.values():
        largest, weights = max(proportional, key=lambda item: item[0])
        fractions = tuple(sorted(amount / largest for amount, _ in proportional))
        loadings.append(Loading(weights, fractions, held_out, optional))
    return loadings


def prepare_jobs(
    device: Device, mesh: QuadraticMesh, plan: Sequence[Loading]
) -> tuple[list[Loading], list[Job], list[str]]:
    """Convert loadings to jobs of the solver.

    Args:
        device: The device.
        mesh: The mesh.
        plan: The loadings.

    Returns:
        The loadings without optional ones that cannot be mixed, a job for each, and warnings.

    Raises:
        DeviceError: A pose does not hold the body, or poses that must be mixed do not fit together.
    """
    kept, jobs, warnings = [], [], []
    for loading in plan:
        try:
            conditions = mix_poses(
                device.poses, loading.weights, device.regions, mesh, device.material.density
            )
            constraint_warnings = check_constraints(mesh, conditions, loading.label)
        except DeviceError as error:
            if not loading.optional:
                raise
            warnings.append(f"{' and '.join(loading.weights)}{NOT_MIXED}{error}")
            continue
        kept.append(loading)
        warnings += constraint_warnings
        fixed = {n for p in device.poses if loading.weights.get(p.name) for n in p.fixed}
        for name in sorted(fixed):
            nodes = np.flatnonzero(device.regions[name].contains(mesh.nodes))
            warnings += warn_small_region(mesh, nodes, name)
        budget = PROPOSED_BUDGET if loading.optional else STATE_BUDGET
        jobs.append(Job(conditions, loading.fractions, loading.label, budget))
    return kept, jobs, list(dict.fromkeys(warnings))


def describe_states(states: Sequence[StateRecord], spec: StatesSpec) -> str:
    """Return a sentence on the states that a design used, and which of them were proposed.

    Args:
        states: The solved states.
        spec: The states of the device, which mark the lists that the user gave.
    """
    fitted, unseen = ([s for s in states if s.held_out is held] for held in (False, True))
    return (
        f"states: {_count_states(fitted, spec.mixtures_given)} fitted,"
        f" {_count_states(unseen, spec.held_out_given)} held out"
    )


def _count_states(states: Sequence[StateRecord], is_given: bool) -> str:
    """Return the numbers of states of one pose and of mixtures, as in "12 of 3 poses"."""
    single = [s for s in states if len(s.weights) == 1]
    poses = len({name for s in single for name in s.weights})
    parts = [f"{len(single)} of {poses} pose{'s' if poses > 1 else ''}"] if single else []
    mixed = len(states) - len(single)
    if mixed:
        parts.append(
            f"{mixed} mixture{'s' if mixed > 1 else ''}{'' if is_given else ' (proposed)'}"
        )
    return " and ".join(parts) or "none"
