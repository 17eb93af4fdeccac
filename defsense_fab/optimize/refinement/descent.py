"""One descent from a layout: the objective under its constraints, by quadratic programmes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ..limits.constraints import MARGIN_MM, Constraints
from ..limits.thin_parts import ThinParts
from ..problem.cord_kinematics import place_cord
from ..problem.cord_parameters import CordParameters, independent_parameters, shared_parameters
from ..problem.objective import QuadraticModel, Objective
from ..problem.problem import Problem
from ..search.starting_layouts import Layout
from .sqp import minimize

#: What a descent may use up of the margin of the limits, mm: the rest is for what samples miss.
MAX_MARGIN_USE_MM = 0.6 * MARGIN_MM


def jitter(layout: Layout, rng: np.random.Generator, *, tied: bool) -> Layout:
    """A slight push off a drawing: symmetric drawings are saddle points. Cords in one plane stay in
    one if `tied`; otherwise they were only drawn there, and need not."""
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
    """The layout after so many iterations, or fewer where they gain less than `tolerance` each;
    `forgiven` mm of the limits' margin may be used up where the layout does so; `show` as in
    `minimise`, and `follow` the layout after each step, with its expected RMSE (mm). Coplanar cords
    stay so; no slivers come where none are."""
    cords, spread = shared_parameters(sensors)
    if not spread.shape[1]:  # a plane that another, locked cord holds is no freedom
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

    def followed(y: Float, value: float) -> None:
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
        follow=followed,
    )
    return _apply_parameters(cords, spread @ found.x, sensors)


def _apply_parameters(cords: Sequence[CordParameters], x: Float, layout: Layout) -> Layout:
    """The layout with its cords at parameters x (size,), as free as before."""
    parts = np.split(x, np.cumsum([c.size for c in cords[:-1]]))
    moved = zip(cords, parts, layout, strict=True)
    return tuple(replace(place_cord(c, part).sensor(), free=s.free) for c, part, s in moved)
