"""Sequential quadratic programming with a trust region: a smooth value, rough inequalities.

Each step minimises the Gauss-Newton model of the value's logarithm under the linearised
inequalities (Nocedal & Wright, Numerical Optimization, 2nd ed., sec. 18.5, with the elastic mode of
sec. 18.2). Depths and distances have kinks: near an edge of the body the nearest face changes, and
the linearisation knows one face only. What a rejected trial found broken is therefore kept as
further linear inequalities, the cuts of bundle methods: exact where the body is convex.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import daqp
import numpy as np

from ...core.arrays import Float
from ..problem.objective import QuadraticModel

#: Values (g,), at least zero where met, and derivatives (g, size).
Rows = tuple[Float, Float]

_MAX_RADIUS_MM, _MIN_RADIUS_MM = 8.0, 2e-3  # trust radius, mm
_DAMPING = 1e-4  # of the logarithm, 1/mm^2: directions that change nothing stay still
_KEPT_CUTS = 4  # cuts kept after a step
_REACH_FACTOR = 1.0  # of the worst that a step could do to an inequality: what a step looks at
_FEASIBILITY_MM = 1e-3  # mm
_MAX_FORGIVEN_MM = 0.05  # of a violation that the margins of the inequalities forgive, mm, the most
_PENALTY = 10.0  # of the logarithm, per mm


@dataclass(frozen=True)
class Minimum:
    """Parameters (size,), the value there, the worst violation, mm, and the iterations taken."""

    x: Float
    value: float
    violation: float
    iterations: int


def minimize(
    model: Callable[[Float], QuadraticModel],
    value: Callable[[Float], float],
    constraints: Callable[[Float], Rows],
    x: Float,
    iterations: int,
    *,
    tolerance: float = 1e-4,
    radius: float = 2.0,
    loosest: float = 0.0,
    guard: Callable[[Float, Float], Rows | None] | None = None,
    show: Callable[[float, float], None] | None = None,
    follow: Callable[[Float, float], None] | None = None,
) -> Minimum:
    """The best x (size,) mm near the given one.

    Ends when a step promises less than `tolerance` of the value, at the last x that met the
    inequalities, or nearly: what breaks them at first by up to `loosest` may go on doing so, and
    in the end they are not broken by more. `guard(x, trial)` may refuse a trial that the
    constraints allow, with inequalities at the trial that rule it out. `show` gets the share of
    iterations done and the value after each step, `follow` the x (size,) that it has come to and
    the value.
    """
    at, (room, rows) = model(x), constraints(x)
    given = float(np.clip(-room.min(), 0.0, loosest))
    nearly = min(_MAX_FORGIVEN_MM, loosest - given)
    room = room + given
    penalty, weight, done = _PENALTY, 1.0, 0
    kept = (x, at.value, max(0.0, -float(room.min())))
    cuts: list[tuple[Float, Float, Float]] = []
    for done in range(1, iterations + 1):
        broken = max(0.0, -float(room.min()))
        near = room < _REACH_FACTOR * radius * np.abs(rows).sum(axis=1)
        left, sides = [room[near]], [rows[near]]
        for where, was, by in cuts:
            now = was + by @ (x - where)
            left.append(np.maximum(now, -broken))
            sides.append(by)
        step, slack, pressure, found = _solve_subproblem(
            weight * at.hessian / at.value,
            at.gradient / at.value,
            np.concatenate(left),
            np.concatenate(sides),
            radius,
            penalty,
        )
        if not found:
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
        (room_then, rows_then), refused = constraints(trial), None
        room_then = room_then + given
        gained = float(np.log(at.value) - np.log(value(trial)))
        broken_then = max(0.0, -float(room_then.min()))
        ratio = (gained + penalty * (broken - broken_then)) / max(promised, 1e-300)
        good = ratio > 0.1
        if good and guard is not None:
            refused = guard(x, trial)
        if refused is not None:
            cuts.append((trial, *refused))
        elif ratio < 0.7 and (bad := room_then < -_FEASIBILITY_MM).any():
            cuts.append((trial, room_then[bad], rows_then[bad]))
        length = float(np.abs(step).max())
        if good and refused is None:
            # The Gauss-Newton matrix is too stiff where the map's residual bends away.
            factor = 2 / 3 if ratio > 1.25 else 1.5 if ratio < 0.75 else 1.0
            weight = float(np.clip(weight * factor, 0.05, 1))
            x, at, room, rows = trial, model(trial), room_then, rows_then
            cuts = cuts[-_KEPT_CUTS:]
            if broken_then <= max(nearly, _FEASIBILITY_MM, kept[2]):
                kept = (x, at.value, broken_then)
            if ratio > 0.7 and length > 0.99 * radius:
                radius = min(2 * radius, _MAX_RADIUS_MM)
            if show is not None:
                show(done / iterations, at.value)
            if follow is not None:
                follow(x, at.value)
        elif gained > 0.3 * drop:
            radius *= 0.7  # only inequalities were misjudged: the cuts know better now
        else:
            radius = 0.4 * min(radius, length)
        if radius < _MIN_RADIUS_MM:
            break
    return Minimum(*kept, done)


def _solve_subproblem(
    hessian: Float, gradient: Float, room: Float, rows: Float, radius: float, penalty: float
) -> tuple[Float, float, float, bool]:
    """The step (size,) within the trust region, by how much all inequalities had to be loosened,
    the sum of their multipliers, and whether the programme was solved."""
    n = len(gradient)
    H = np.zeros((n + 1, n + 1))
    H[:n, :n] = hessian
    H[range(n), range(n)] += _DAMPING
    H[n, n] = _DAMPING
    A = np.hstack([rows, np.ones((len(rows), 1))])
    low = np.concatenate([np.full(n, -radius), [0.0], -room])
    high = np.concatenate([np.full(n, radius), [1e3], np.full(len(rows), 1e30)])
    found, _, flag, info = daqp.solve(
        H, np.append(gradient, penalty), A, high, low, np.zeros(len(low), np.int32)
    )
    if flag < 1 or not np.isfinite(found).all():
        # The arrays of a programme that was not solved are memory that nobody has written to.
        return np.zeros(n), 0.0, 0.0, False
    return found[:n], float(found[n]), float(np.abs(info["lam"][n + 1 :]).sum()), True
