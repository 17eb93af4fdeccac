"""Descend from a layout: minimize the objective under the limits by quadratic programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ..limits.constraints import MARGIN_MM, Constraints
from ..limits.thin_parts import ThinParts
from ..problem.cord_kinematics import place_cord
from ..problem.cord_parameters import CordParameters, independent_parameters, shared_parameters
from ..problem.objective import Objective, QuadraticModel
from ..problem.problem import Problem
from ..search.starting_layouts import Layout
from .sqp import minimize

#: Part of the limits' margin that a descent may use up; the rest covers what samples miss.
MAX_MARGIN_USE_MM = 0.6 * MARGIN_MM


def jitter(layout: Layout, rng: np.random.Generator, *, tied: bool) -> Layout:
    """Move a layout slightly at random, because symmetric drawings are saddle points.

    Args:
        layout: The layout.
        rng: Random generator.
        tied: Keep cords that share a plane in one plane; otherwise each moves independently.
    """
    cords, spread = shared_parameters(layout) if tied else independent_parameters(layout)
    return _apply_parameters(cords, spread @ rng.normal(0, 1.5, spread.shape[1]), layout)


def descend(
    problem: Problem,
    sensors: Layout,
    iterations: int,
    tolerance: float,
    slivers: ThinParts,
    show: Callable[[float, float], None],
    forgiven: float = MAX_MARGIN_USE_MM,
    follow: Callable[[Layout, float], None] | None = None,
) -> Layout:
    """Descend from a layout; coplanar cords stay coplanar, and no slivers appear.

    Args:
        problem: The problem.
        sensors: The layout to start from.
        iterations: Largest number of iterations.
        tolerance: Stop when an iteration gains a smaller share of the squared error.
        slivers: Detector of slivers.
        show: Called after each step with the share of iterations done and the squared error.
        forgiven: Part of the limits' margin (mm) that may be used up if the layout does so.
        follow: Called after each step with the layout and its expected RMSE (mm).
    """
    cords, spread = shared_parameters(sensors)
    if not spread.shape[1]:  # nothing is free, as when a locked cord holds the plane
        return sensors
    objective = Objective(problem, cords)
    constraints = Constraints(problem.surface, problem.depth, problem.limits, cords)

    def model(y: Float) -> QuadraticModel:
        at = objective.model(spread @ y)
        return QuadraticModel(at.value, at.gradient @ spread, spread.T @ at.hessian @ spread)

    def limits(y: Float) -> tuple[Float, Float]:
        room, rows = constraints(spread @ y)
        return room, rows @ spread

    def guard(old: Float, new: Float) -> tuple[Float, Float] | None:
        found = slivers.guard(cords, spread @ old, spread @ new)
        return None if found is None else (found[0], found[1] @ spread)

    def report_step(y: Float, value: float) -> None:
        if follow is not None:
            follow(_apply_parameters(cords, spread @ y, sensors), float(np.sqrt(value)))

    found = minimize(
        model,
        lambda y: objective.value(spread @ y),
        limits,
        np.zeros(spread.shape[1]),
        iterations,
        tolerance=tolerance,
        loosest=forgiven,
        guard=guard if not slivers(sensors) else None,
        show=show,
        follow=report_step,
    )
    return _apply_parameters(cords, spread @ found.x, sensors)


def _apply_parameters(cords: Sequence[CordParameters], x: Float, layout: Layout) -> Layout:
    """Return the layout with its cords at parameters x (size,), as free as before."""
    parts = np.split(x, np.cumsum([c.size for c in cords[:-1]]))
    moved = zip(cords, parts, layout, strict=True)
    return tuple(replace(place_cord(c, part).sensor(), free=s.free) for c, part, s in moved)
