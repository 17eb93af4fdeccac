"""From one set of boundary conditions to another in steps that adapt, with a status for each."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from ...core.arrays import Float
from ..elements.material import Material
from ..elements.tet10 import QuadraticMesh
from ..loading.boundary_conditions import (
    BoundaryConditions,
    State,
    interpolate_conditions,
    continue_handles,
    rest_state,
)
from .fields import check_field
from .newton import INTERMEDIATE_TOLERANCE, TOLERANCE, Cancelled, System

MIN_STEP = 1 / 16
#: Matrices of a step after which the next one is larger.
EASY_STEP_MATRICES = 5
#: No step rotations a handle further (rad), or the solver could land in another equilibrium.
MAX_STEP_TURN_RAD = np.deg2rad(100)
#: Of the body's size: displacements that differ by less are one equilibrium.
_SAME = 0.01


class Status(StrEnum):
    """How a solve ended. NOT_REACHED and CANCELLED come without a field."""

    OK = "ok"
    UNSOUND = "unsound"  # in equilibrium, but inverted, through itself, or one of several
    UNSTABLE = "unstable"  # in equilibrium, but at a saddle of the energy: the body would buckle
    NOT_REACHED = "not reached"
    CANCELLED = "cancelled"


@dataclass(frozen=True)
class SolveStatistics:
    """Counts of linear solves, factorised matrices and load steps; residual relative to the
    largest nodal force; stored energy (N mm); wall time (s)."""

    iterations: int
    factors: int
    steps: int
    residual: float
    energy: float
    seconds: float


@dataclass(frozen=True)
class Equilibrium:
    """The outcome at one load fraction.

    `state` is None unless the equilibrium was reached; `amplitude` is what was reached, and
    `largest` the state there where it is not the one asked for.
    """

    status: Status
    state: State | None
    amplitude: float
    statistics: SolveStatistics
    last_state: State | None = field(default=None, repr=False)
    problem: str | None = None

    @property
    def converged(self) -> bool:
        return self.state is not None

    @property
    def u(self) -> Float | None:
        """Displacements (n, 3) mm."""
        return None if self.state is None else self.state.u


def solve_ramp(
    mesh: QuadraticMesh,
    material: Material,
    conditions: BoundaryConditions,
    fractions: Sequence[float],
    on_step: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
    threads: int = 1,
) -> list[Equilibrium]:
    """Equilibria at increasing load `fractions`, from rest; stops at the first not reached."""
    system = System(mesh, material, conditions, threads)
    try:
        start = rest_state(conditions, len(mesh.nodes))
        return follow(system, start, conditions, fractions, on_step, stop)
    finally:
        system.close()


def follow(
    system: System,
    start: State,
    goal: BoundaryConditions,
    fractions: Sequence[float] = (1.0,),
    on_step: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
    check: bool = True,
    guess: Float | None = None,
    largest_turn: float = MAX_STEP_TURN_RAD,
    tolerance: float = TOLERANCE,
) -> list[Equilibrium]:
    """Equilibria at the `fractions` of the way from `start` (an equilibrium) to `goal`.

    `start` may be any pose of the same structure: a neighbouring one saves steps. After a fraction
    that was not reached or a `stop` the list ends with a record without a state. `check` looks for
    inverted tets and for a surface that passes through itself, and whether the state is a minimum
    of the energy. `guess` (n, 3) mm is how far the body is expected to move to the goal, as a
    coarser mesh tells. No step rotations a handle by more than `largest_turn`, rad. `tolerance` is that
    of the residual at the fractions, relative to the largest nodal force.
    """
    if goal.structure != system.structure:
        raise ValueError("the goal's boundary conditions differ in structure from the system's")
    home, state, at = start.conditions, start, 0.0
    largest = 1.0 / math.ceil(max(_turn(home, goal) / largest_turn - 1e-9, 1.0))
    step = largest
    if largest < 1 or list(fractions) != [1.0]:
        guess = None
    results: list[Equilibrium] = []
    for target in fractions:
        began = time.perf_counter()
        smallest = min(MIN_STEP, (target - at) / 4)
        iterations = factors = steps = 0
        residual = energy = np.inf
        stable = True

        def statistics() -> SolveStatistics:
            seconds = time.perf_counter() - began  # noqa: B023
            return SolveStatistics(iterations, factors, steps, residual, energy, seconds)  # noqa: B023

        while at < target - 1e-12:
            there = min(at + step, target)
            if target - there < 0.25 * step:
                there = target
            try:
                attempt = system.step(
                    state,
                    interpolate_conditions(home, goal, there),
                    stop,
                    guess,
                    tolerance if there == target else INTERMEDIATE_TOLERANCE,
                )
                guess = None  # holds for one step to the goal
            except Cancelled:
                results.append(Equilibrium(Status.CANCELLED, None, at, statistics(), state))
                return results
            iterations += attempt.solves
            factors += attempt.factors
            if attempt.state is None:
                step = (there - at) / 2
                if step < smallest:
                    results.append(Equilibrium(Status.NOT_REACHED, None, at, statistics(), state))
                    return results
                continue
            state, at = attempt.state, there
            residual, energy, stable = attempt.residual, attempt.energy, attempt.stable
            steps += 1
            if attempt.factors <= EASY_STEP_MATRICES:
                step = min(2 * step, largest)
            if on_step:
                on_step(at)
        problem = check_field(system.mesh, state.u).problem() if check else None
        status = Status.OK
        if problem:
            status = Status.UNSOUND
        elif check and not (stable or system.is_stable(state)):
            status, problem = Status.UNSTABLE, "the equilibrium is unstable: the body would buckle"
        results.append(Equilibrium(status, state, at, statistics(), None, problem))
    return results


def continue_from_free(
    mesh: QuadraticMesh,
    material: Material,
    found: Sequence[Equilibrium],
    threads: int = 1,
    stop: Callable[[], bool] | None = None,
) -> list[Equilibrium]:
    """The equilibria with their handles moved on from where they came to lie, where that is asked
    for. Amplitudes and statistics are those of the way there."""
    out, system = [], None
    try:
        for one in found:
            further = continue_handles(one.state) if one.state is not None else None
            if further is None:
                out.append(one)
                continue
            start, goal = further
            if system is None:
                system = System(mesh, material, goal, threads)
            (there,) = follow(system, start, goal, stop=stop)
            out.append(replace(there, amplitude=there.amplitude * one.amplitude))
            if not there.converged:
                break
    finally:
        if system is not None:
            system.close()
    return out


def confirm_equilibria(
    system: System,
    start: State,
    goal: BoundaryConditions,
    found: Sequence[Equilibrium],
    fractions: Sequence[float],
    stop: Callable[[], bool] | None = None,
) -> list[Equilibrium]:
    """What `follow` found at the fractions, those of large rotations compared with what half the
    steps come to: where that is elsewhere, or nowhere, there is more than one equilibrium, and the
    one that was found is UNSOUND."""
    if _turn(start.conditions, goal) <= MAX_STEP_TURN_RAD:
        return list(found)
    fewer = follow(
        system, start, goal, fractions, None, stop, check=False, largest_turn=MAX_STEP_TURN_RAD / 2
    )
    size = float(np.linalg.norm(np.ptp(system.mesh.nodes, axis=0)))
    out = list(found)
    for k, one in enumerate(found):
        other = fewer[k] if k < len(fewer) else fewer[-1]
        if one.u is None or other.status is Status.CANCELLED:
            continue
        if k >= len(fewer) or other.u is None:
            problem = "half the steps do not reach it"
        else:
            apart = float(np.linalg.norm(one.u - other.u, axis=1).max())
            if apart <= _SAME * size:
                continue
            problem = f"half the steps end {apart:.3g} mm elsewhere"
        problem += ": there is more than one equilibrium, and a body may take another"
        both = problem if one.problem is None else f"{one.problem}; {problem}"
        out[k] = replace(one, status=Status.UNSOUND, problem=both)
    return out


def _turn(home: BoundaryConditions, goal: BoundaryConditions) -> float:
    """How far the handle is turned that is turned the most, rad."""
    return max(
        (
            float(np.linalg.norm(b.rotation - a.rotation))
            for a, b in zip(home.handles, goal.handles, strict=True)
        ),
        default=0.0,
    )
