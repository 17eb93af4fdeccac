"""Solve proposed poses, and weaken or drop those that a body cannot or should not be moved through.

Vibration modes are small. At the amplitude of a pose a thin limb may tear, or buckle so that its
states take many times as long as the others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.device.device import Device, Handle, Pose
from ...core.device.materials import elongation_at_break
from ...core.device.regions import Shape
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.pose import mix_poses
from ...mechanics.solver.batch import Job, Solve, solve_all
from ...mechanics.solver.fields import check_field, locate_largest_strain
from ...mechanics.solver.linear_response import ProposedPose
from ...mechanics.solver.load_stepping import Equilibrium, Status

#: Amplitudes of a weakened pose, relative to the proposed one.
WEAKER = (0.25, 0.5, 0.75)
#: Factorizations of a pose relative to the median of the others above which it is too slow.
MAX_EFFORT_RATIO = 10.0
#: Factorizations after which a trial is given up: that many times those of usual poses.
TRIAL_BUDGET = 40


@dataclass(frozen=True)
class _Trial:
    """The outcome at one amplitude: largest strain (NaN if not reached, infinite if tets are
    inverted) and factorizations.
    """

    amplitude: float
    strain: float
    effort: int

    def problem(self, max_strain: float, max_effort: float) -> str:
        """Return why a pose cannot have this amplitude; an empty text if it can."""
        if np.isnan(self.strain):
            return "the solver does not reach it within its budget"
        if np.isinf(self.strain):
            return "it turns tets of the mesh inside out"
        if self.strain > max_strain:
            return (
                f"it strains the body by {self.strain:.0%}, and the material breaks at"
                f" {max_strain:.0%}"
            )
        return "it takes ten times as long as the other poses" if self.effort > max_effort else ""


def try_poses(
    device: Device,
    mesh: QuadraticMesh,
    fixed: str,
    end: tuple[str, Shape],
    poses: Sequence[ProposedPose],
    solve: Solve = solve_all,
    report: Callable[[float], None] | None = None,
) -> tuple[list[ProposedPose], list[str]]:
    """Return the poses that the body can be moved through, weakened where necessary.

    Args:
        device: The device.
        mesh: Its mesh.
        fixed: Name of the held region.
        end: Name and shape of the region that the poses move.
        poses: Proposed poses.
        solve: `solve_all`, or a function that does the same elsewhere.
        report: Called with the completed fraction.

    Returns:
        The poses, and a note on each pose that was changed or dropped.
    """
    regions = {**device.regions, end[0]: end[1]}
    limit = elongation_at_break(device.material.name)
    max_strain = np.inf if limit is None else limit

    def run(chosen: Sequence[ProposedPose], amplitudes: tuple[float, ...]) -> list[list[_Trial]]:
        jobs = [_job(device, mesh, p, fixed, end[0], regions, amplitudes) for p in chosen]
        progress = None
        if report:
            done = dict.fromkeys(range(len(jobs)), 0.0)

            def progress(job: int, fraction: float) -> None:
                done[job] = fraction
                report(sum(done.values()) / len(done))

        solved = solve(mesh, Material.from_spec(device.material), jobs, progress)
        return [_list_trials(mesh, results, amplitudes) for results in solved]

    whole = [trials[0] for trials in run(poses, (1.0,))]
    max_effort = [_max_effort(whole, k) for k in range(len(whole))]
    problems = [t.problem(max_strain, m) for t, m in zip(whole, max_effort, strict=True)]
    failed = [k for k, problem in enumerate(problems) if problem]
    weaker = dict(zip(failed, run([poses[k] for k in failed], WEAKER), strict=True))
    kept, notes = [], []
    for k, pose in enumerate(poses):
        if k not in weaker:
            kept.append(pose)
            continue
        possible = [t.amplitude for t in weaker[k] if not t.problem(max_strain, max_effort[k])]
        if not possible:
            notes.append(f"{pose.name} is not proposed: {problems[k]}")
            continue
        kept.append(_scale(pose, max(possible)))
        notes.append(f"{pose.name} has {max(possible):.0%} of the usual amplitude: {problems[k]}")
    return kept, notes


def _job(
    device: Device,
    mesh: QuadraticMesh,
    pose: ProposedPose,
    fixed: str,
    end: str,
    regions: Mapping[str, Shape],
    amplitudes: tuple[float, ...],
) -> Job:
    handle = Handle(end, pose.rotation, pose.translation)
    poses = (Pose(pose.name, (fixed,), (handle,)),)
    conditions = mix_poses(poses, {pose.name: 1.0}, regions, mesh, device.material.density)
    return Job(conditions, amplitudes, pose.name, TRIAL_BUDGET)


def _list_trials(
    mesh: QuadraticMesh, results: Sequence[Equilibrium], amplitudes: tuple[float, ...]
) -> list[_Trial]:
    trials, effort = [], 0
    for amplitude, result in zip(amplitudes, results, strict=False):
        effort += result.statistics.factors
        strain = np.nan
        if result.u is not None:
            strain = locate_largest_strain(mesh, result.u)[0]
            if result.status is Status.UNSOUND and len(check_field(mesh, result.u).inverted):
                strain = np.inf
        trials.append(_Trial(amplitude, strain, effort))
    return trials


def _max_effort(trials: Sequence[_Trial], k: int) -> float:
    """Return the largest effort of pose `k`, given those of the others."""
    others = [t.effort for i, t in enumerate(trials) if i != k]
    return MAX_EFFORT_RATIO * float(np.median(others)) if others else np.inf


def _scale(pose: ProposedPose, amplitude: float) -> ProposedPose:
    return replace(
        pose, rotation=amplitude * pose.rotation, translation=amplitude * pose.translation
    )
