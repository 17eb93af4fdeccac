"""Minimize a smooth value under kinked inequalities by sequential quadratic programming.

Each step minimizes the Gauss-Newton model of the value's logarithm under the linearized
inequalities, within a trust region (Nocedal & Wright, Numerical Optimization, 2nd ed., sec. 18.5,
with the elastic mode of sec. 18.2). Depths and distances have kinks: near an edge of the body the
nearest face changes, and the linearization knows only one face. Inequalities that a rejected trial
breaks are therefore kept as further linear inequalities, the cuts of bundle methods, which are
exact where the body is convex.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import daqp
import numpy as np

from ...core.arrays import Float
from ..problem.objective import QuadraticModel

#: Values (g,), at least zero where met, and derivatives (g, size).
Rows = tuple[Float, Float]
#: Parameters (size,) of a trial, with inequalities there.
_Cut = tuple[Float, Float, Float]

_FIRST_RADIUS_MM, _MAX_RADIUS_MM, _MIN_RADIUS_MM = 2.0, 8.0, 2e-3  # of the trust region
_DAMPING = 1e-4  # added to the Hessian of the logarithm, 1/mm^2: flat directions stay still
_KEPT_CUTS = 4  # after a step
_REACH_FACTOR = 1.0  # a step considers inequalities within this multiple of its largest effect
_FEASIBILITY_MM = 1e-3  # violations below count as none
_MAX_FORGIVEN_MM = 0.05  # largest further violation that the margins of the inequalities forgive
_PENALTY = 10.0  # of the logarithm, 1/mm


@dataclass(frozen=True)
class Minimum:
    """The result of a minimization.

    Attributes:
        x: (size,) mm, the parameters.
        value: The value there.
        violation: The worst violation of an inequality, mm.
        iterations: Number of iterations.
    """

    x: Float
    value: float
    violation: float
    iterations: int


class Program(Protocol):
    """A value to minimize under inequalities, as functions of parameters x (size,) in mm."""

    def model(self, x: Float) -> QuadraticModel:
        """Return the quadratic model of the value at x."""

    def value(self, x: Float) -> float:
        """Return the value alone."""

    def inequalities(self, x: Float) -> Rows:
        """Return the inequalities at x."""

    def guard(self, x: Float, trial: Float) -> Rows | None:
        """Return inequalities at a trial that rule it out although it meets the others, or None."""


def minimize(
    program: Program,
    x: Float,
    iterations: int,
    *,
    tolerance: float = 1e-4,
    loosest: float = 0.0,
    on_step: Callable[[Float, float, float], None] | None = None,
) -> Minimum:
    """Minimize a value under inequalities, starting from given parameters.

    The result is the last x that satisfied the inequalities. If they are broken at the start by up
    to `loosest`, they may stay broken by as much, but not by more.

    Args:
        program: The value and the inequalities.
        x: Start (size,) mm.
        iterations: Largest number of iterations.
        tolerance: Stop when a step promises a smaller relative decrease.
        loosest: Largest violation at the start that is tolerated, mm.
        on_step: Called after each step with x (size,), the value and the share of iterations done.
    """
    at, (room, rows) = program.model(x), program.inequalities(x)
    start_violation = float(np.clip(-room.min(), 0.0, loosest))
    forgiven = min(_MAX_FORGIVEN_MM, loosest - start_violation)
    room = room + start_violation
    radius, penalty, weight, iteration = _FIRST_RADIUS_MM, _PENALTY, 1.0, 0
    best = (x, at.value, max(0.0, -float(room.min())))
    cuts: list[_Cut] = []
    for iteration in range(1, iterations + 1):
        broken = max(0.0, -float(room.min()))
        step, slack, pressure, is_solved = _solve_subproblem(
            weight * at.hessian / at.value,
            at.gradient / at.value,
            _linearize(x, (room, rows), cuts, radius),
            radius,
            penalty,
        )
        if not is_solved:
            radius /= 4
            if radius < _MIN_RADIUS_MM:
                break
            continue
        if slack > 1e-6 and penalty < 1e3:
            penalty *= 4
        penalty = max(penalty, 2 * pressure if pressure > penalty / 2 else 0.0)
        drop = float(-(at.gradient @ step + weight / 2 * step @ at.hessian @ step) / at.value)
        promised = drop + penalty * (broken - slack)
        if promised < tolerance and broken < _FEASIBILITY_MM:
            break
        trial = x + step
        room_then, rows_then = program.inequalities(trial)
        room_then = room_then + start_violation
        gained = float(np.log(at.value) - np.log(program.value(trial)))
        broken_then = max(0.0, -float(room_then.min()))
        ratio = (gained + penalty * (broken - broken_then)) / max(promised, 1e-300)
        refused = program.guard(x, trial) if ratio > 0.1 else None
        if refused is not None:
            cuts.append((trial, *refused))
        elif ratio < 0.7 and (bad := room_then < -_FEASIBILITY_MM).any():
            cuts.append((trial, room_then[bad], rows_then[bad]))
        length = float(np.abs(step).max())
        if ratio > 0.1 and refused is None:
            # The Gauss-Newton matrix is too stiff where the map's residual bends away.
            factor = 2 / 3 if ratio > 1.25 else 1.5 if ratio < 0.75 else 1.0
            weight = float(np.clip(weight * factor, 0.05, 1))
            x, at, room, rows = trial, program.model(trial), room_then, rows_then
            cuts = cuts[-_KEPT_CUTS:]
            if broken_then <= max(forgiven, _FEASIBILITY_MM, best[2]):
                best = (x, at.value, broken_then)
            if ratio > 0.7 and length > 0.99 * radius:
                radius = min(2 * radius, _MAX_RADIUS_MM)
            if on_step is not None:
                on_step(x, at.value, iteration / iterations)
        elif gained > 0.3 * drop:
            radius *= 0.7  # only inequalities were misjudged, which the cuts now describe
        else:
            radius = 0.4 * min(radius, length)
        if radius < _MIN_RADIUS_MM:
            break
    return Minimum(*best, iteration)


def _linearize(x: Float, near: Rows, cuts: Sequence[_Cut], radius: float) -> Rows:
    """Return the inequalities at x that a step within the trust radius may break, and the cuts."""
    room, rows = near
    broken = max(0.0, -float(room.min()))
    is_near = room < _REACH_FACTOR * radius * np.abs(rows).sum(axis=1)
    rooms, sides = [room[is_near]], [rows[is_near]]
    for where, was, by in cuts:
        rooms.append(np.maximum(was + by @ (x - where), -broken))
        sides.append(by)
    return np.concatenate(rooms), np.concatenate(sides)


def _solve_subproblem(
    hessian: Float, gradient: Float, inequalities: Rows, radius: float, penalty: float
) -> tuple[Float, float, float, bool]:
    """Solve the quadratic program of one step.

    Returns the step (size,), by how much all inequalities had to be loosened, the sum of their
    multipliers, and whether the program was solved.
    """
    n, (room, rows) = len(gradient), inequalities
    H = np.zeros((n + 1, n + 1))
    H[:n, :n] = hessian
    H[range(n), range(n)] += _DAMPING
    H[n, n] = _DAMPING
    A = np.hstack([rows, np.ones((len(rows), 1))])
    low = np.concatenate([np.full(n, -radius), [0.0], -room])
    high = np.concatenate([np.full(n, radius), [1e3], np.full(len(rows), 1e30)])
    solution, _, flag, info = daqp.solve(
        H, np.append(gradient, penalty), A, high, low, np.zeros(len(low), np.int32)
    )
    if flag < 1 or not np.isfinite(solution).all():
        # The arrays of a program that was not solved are uninitialized memory.
        return np.zeros(n), 0.0, 0.0, False
    return solution[:n], float(solution[n]), float(np.abs(info["lam"][n + 1 :]).sum()), True
