"""Follow equilibria from one set of boundary conditions to another in adaptive load steps."""

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
    continue_handles,
    interpolate_conditions,
    rest_state,
)
from .fields import check_field
from .newton import INTERMEDIATE_TOLERANCE, TOLERANCE, Attempt, Cancelled, System

MIN_STEP = 1 / 16  # of the way
EASY_STEP_MATRICES = 5  # a step that takes no more doubles the next one
#: Largest turn of a handle in one step; beyond, the solver could reach another equilibrium.
MAX_STEP_TURN_RAD = np.deg2rad(100)
_SAME_EQUILIBRIUM_RTOL = 0.01  # of the body's size, by which one equilibrium may differ


class Status(StrEnum):
    """How a solve ended. `NOT_REACHED`, `OVER_BUDGET` and `CANCELLED` come without a field."""

    OK = "ok"
    UNSOUND = "unsound"  # equilibrium, but inverted, self-penetrating, or one of several
    UNSTABLE = "unstable"  # equilibrium, but a saddle of the energy: the body would buckle
    NOT_REACHED = "not reached"
    OVER_BUDGET = "over budget"
    CANCELLED = "cancelled"


@dataclass(frozen=True)
class SolveStatistics:
    """Effort and accuracy of a solve.

    Attributes:
        iterations: Number of linear solves.
        factors: Number of factorized matrices.
        steps: Number of load steps.
        residual: Residual relative to the largest nodal force.
        energy: Potential energy, N mm.
        seconds: Wall time, s.
    """

    iterations: int
    factors: int
    steps: int
    residual: float
    energy: float
    seconds: float


@dataclass(frozen=True)
class Equilibrium:
    """The outcome at one load fraction.

    Attributes:
        status: How the solve ended.
        state: The equilibrium, None if it was not reached.
        amplitude: Load fraction that was reached.
        statistics: Effort and accuracy.
        last_state: State at `amplitude`, if the requested fraction was not reached.
        problem: What is wrong with the equilibrium, for people.
    """

    status: Status
    state: State | None
    amplitude: float
    statistics: SolveStatistics
    last_state: State | None = field(default=None, repr=False)
    problem: str | None = None

    @property
    def converged(self) -> bool:
        """Whether the equilibrium was reached."""
        return self.state is not None

    @property
    def u(self) -> Float | None:
        """Displacements (n, 3) mm, None if the equilibrium was not reached."""
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
    """Solve equilibria at increasing load fractions, starting from rest.

    Args:
        mesh: Mesh of the body.
        material: Its material.
        conditions: Boundary conditions at fraction 1.
        fractions: Increasing load fractions.
        on_step: Called with the fraction reached after each step.
        stop: Returns True to cancel.
        threads: Number of threads.

    Returns:
        One record per fraction, up to the first that was not reached.
    """
    system = System(mesh, material, conditions, threads)
    try:
        start = rest_state(conditions, len(mesh.nodes))
        return follow(system, start, conditions, fractions, on_step, stop)
    finally:
        system.close()


@dataclass(frozen=True)
class Stepping:
    """How load steps are taken, and their results checked.

    Attributes:
        check: Look for inverted tets and self-penetration, and check that the state is a minimum of
            the energy.
        guess: Expected displacement increment (n, 3) mm to the goal, such as that of a coarser
            mesh. It is used only if one step leads to the goal.
        largest_turn: Largest turn of a handle in one step, rad.
        tolerance: Residual at the requested fractions, relative to the largest nodal force.
        budget: Number of factorizations after which a requested fraction is given up; None for no
            limit.
    """

    check: bool = True
    guess: Float | None = None
    largest_turn: float = MAX_STEP_TURN_RAD
    tolerance: float = TOLERANCE
    budget: int | None = None


@dataclass
class _Effort:
    """The effort of the steps to one fraction so far, and the last of them."""

    started_at: float = field(default_factory=time.perf_counter)
    iterations: int = 0
    factors: int = 0
    steps: int = 0
    residual: float = np.inf
    energy: float = np.inf
    stable: bool = True

    def add(self, attempt: Attempt) -> None:
        self.iterations += attempt.solves
        self.factors += attempt.factors
        if attempt.state is not None:
            self.steps += 1
            self.residual, self.energy = attempt.residual, attempt.energy
            self.stable = attempt.stable

    def statistics(self) -> SolveStatistics:
        seconds = time.perf_counter() - self.started_at
        return SolveStatistics(
            self.iterations, self.factors, self.steps, self.residual, self.energy, seconds
        )


def follow(
    system: System,
    start: State,
    goal: BoundaryConditions,
    fractions: Sequence[float] = (1.0,),
    on_step: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
    stepping: Stepping | None = None,
) -> list[Equilibrium]:
    """Solve equilibria at fractions of the way from one equilibrium to other conditions.

    Args:
        system: The system, whose structure `goal` must share.
        start: An equilibrium; one near the goal saves steps.
        goal: Boundary conditions at fraction 1.
        fractions: Increasing fractions of the way.
        on_step: Called with the fraction reached after each step.
        stop: Returns True to cancel.
        stepping: How steps are taken and checked.

    Returns:
        One record per fraction. After a fraction that was not reached within the budget, or a
        cancellation, the list ends with a record without a state.

    Raises:
        ValueError: If `goal` has another structure than the system.
    """
    if goal.structure != system.structure:
        raise ValueError("the goal's boundary conditions differ in structure from the system's")
    stepping = stepping or Stepping()
    home, state, fraction = start.conditions, start, 0.0
    max_step = 1.0 / math.ceil(max(_turn(home, goal) / stepping.largest_turn - 1e-9, 1.0))
    step = max_step
    is_one_step = max_step == 1 and list(fractions) == [1.0]
    guess = stepping.guess if is_one_step else None
    results: list[Equilibrium] = []
    for target in fractions:
        effort = _Effort()
        min_step = min(MIN_STEP, (target - fraction) / 4)
        while fraction < target - 1e-12:
            next_fraction = min(fraction + step, target)
            if target - next_fraction < 0.25 * step:
                next_fraction = target
            tolerance = stepping.tolerance if next_fraction == target else INTERMEDIATE_TOLERANCE
            conditions = interpolate_conditions(home, goal, next_fraction)
            try:
                attempt = system.step(state, conditions, stop, guess, tolerance)
            except Cancelled:
                stats = effort.statistics()
                return [*results, Equilibrium(Status.CANCELLED, None, fraction, stats, state)]
            guess = None  # it is valid for a single step to the goal
            effort.add(attempt)
            failure = None
            if attempt.state is None:
                step = (next_fraction - fraction) / 2
                failure = Status.NOT_REACHED if step < min_step else None
            else:
                state, fraction = attempt.state, next_fraction
            if stepping.budget and effort.factors >= stepping.budget and fraction < target - 1e-12:
                failure = failure or Status.OVER_BUDGET
            if failure:
                return [*results, Equilibrium(failure, None, fraction, effort.statistics(), state)]
            if attempt.state is None:
                continue
            if attempt.factors <= EASY_STEP_MATRICES:
                step = min(2 * step, max_step)
            if on_step:
                on_step(fraction)
        status, problem = Status.OK, None
        if stepping.check:
            status, problem = _check_equilibrium(system, state, effort.stable)
        results.append(Equilibrium(status, state, fraction, effort.statistics(), None, problem))
    return results


def _check_equilibrium(system: System, state: State, stable: bool) -> tuple[Status, str | None]:
    """Return the status of an equilibrium, and what is wrong with it.

    Args:
        system: The system.
        state: The equilibrium.
        stable: Whether it is known to be a minimum of the energy.
    """
    problem = check_field(system.mesh, state.u).problem()
    if problem:
        return Status.UNSOUND, problem
    if not (stable or system.is_stable(state)):
        return Status.UNSTABLE, "the equilibrium is unstable: the body would buckle"
    return Status.OK, None


def continue_from_free(
    mesh: QuadraticMesh,
    material: Material,
    equilibria: Sequence[Equilibrium],
    threads: int = 1,
    stop: Callable[[], bool] | None = None,
    stepping: Stepping | None = None,
) -> list[Equilibrium]:
    """Apply the further translations of handles whose position the solver has found.

    Args:
        mesh: Mesh of the body.
        material: Its material.
        equilibria: Equilibria of one pose at increasing fractions.
        threads: Number of threads.
        stop: Returns True to cancel.
        stepping: How steps are taken and checked.

    Returns:
        The equilibria after the further translation, up to the first that was not reached;
        equilibria without one are returned as they are.
    """
    out, system = [], None
    try:
        for equilibrium in equilibria:
            continuation = (
                continue_handles(equilibrium.state) if equilibrium.state is not None else None
            )
            if continuation is None:
                out.append(equilibrium)
                continue
            start, goal = continuation
            if system is None:
                system = System(mesh, material, goal, threads)
            (moved,) = follow(system, start, goal, stop=stop, stepping=stepping)
            out.append(replace(moved, amplitude=moved.amplitude * equilibrium.amplitude))
            if not moved.converged:
                break
    finally:
        if system is not None:
            system.close()
    return out


def confirm_equilibria(
    system: System,
    start: State,
    goal: BoundaryConditions,
    equilibria: Sequence[Equilibrium],
    fractions: Sequence[float],
    stop: Callable[[], bool] | None = None,
    stepping: Stepping | None = None,
) -> list[Equilibrium]:
    """Compare equilibria of large rotations with those that steps of half the size lead to.

    If those differ or are not reached, there is more than one equilibrium, and the status becomes
    `UNSOUND`.

    Args:
        system: The system that `follow` used.
        start: Its start.
        goal: Its goal.
        equilibria: Its result.
        fractions: Its fractions.
        stop: Returns True to cancel.
        stepping: Its stepping.

    Returns:
        The equilibria with their status updated.
    """
    if _turn(start.conditions, goal) <= MAX_STEP_TURN_RAD:
        return list(equilibria)
    half_steps = replace(stepping or Stepping(), check=False, largest_turn=MAX_STEP_TURN_RAD / 2)
    halved = follow(system, start, goal, fractions, None, stop, half_steps)
    size = float(np.linalg.norm(np.ptp(system.mesh.nodes, axis=0)))
    out = list(equilibria)
    for k, equilibrium in enumerate(equilibria):
        comparison = halved[k] if k < len(halved) else halved[-1]
        if equilibrium.u is None or comparison.status is Status.CANCELLED:
            continue
        if comparison.status is Status.OVER_BUDGET:
            problem = "steps of half the size exceed the budget"
        elif k >= len(halved) or comparison.u is None:
            problem = "steps of half the size do not reach it"
        else:
            distance = float(np.linalg.norm(equilibrium.u - comparison.u, axis=1).max())
            if distance <= _SAME_EQUILIBRIUM_RTOL * size:
                continue
            problem = f"steps of half the size end {distance:.3g} mm away"
        problem += ": there may be more than one equilibrium, and the body may take another"
        description = (
            problem if equilibrium.problem is None else f"{equilibrium.problem}; {problem}"
        )
        out[k] = replace(equilibrium, status=Status.UNSOUND, problem=description)
    return out


def _turn(home: BoundaryConditions, goal: BoundaryConditions) -> float:
    """Return the largest turn of a handle between two conditions, rad."""
    return max(
        (
            float(np.linalg.norm(b.rotation - a.rotation))
            for a, b in zip(home.handles, goal.handles, strict=True)
        ),
        default=0.0,
    )
