"""Descend from a layout: move its free paths and planes until the error stops falling."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...core.arrays import Float
from ..limits.constraints import FLAT_REACH_MM, Constraints
from ..limits.inlets import MARGIN_MM
from ..limits.thin_parts import ThinParts
from ..problem.cord_kinematics import place_cord
from ..problem.cord_parameters import (
    CordParameters,
    independent_parameters,
    shared_parameters,
)
from ..problem.objective import Objective, QuadraticModel
from ..problem.problem import Problem
from ..search.starting_layouts import Layout
from .sqp import minimize

MIN_SPARSE_SIZE = 150  # parameters of all cords from which sparse products are faster
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
    return apply_parameters(cords, spread @ rng.normal(0, 1.5, spread.shape[1]), layout)


def descend(
    problem: Problem,
    sensors: Layout,
    iterations: int,
    tolerance: float,
    slivers: ThinParts,
    show: Callable[[float, float], None],
    forgiven: float = MAX_MARGIN_USE_MM,
    follow: Callable[[Layout, float], None] | None = None,
    reach: float = FLAT_REACH_MM,
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
        reach: How far the mouths of paths in space may move, mm.
    """
    program = _LayoutProgram(problem, sensors, slivers, reach)
    if not program.size:  # nothing is free, as when a locked cord holds the plane
        return sensors

    def on_step(y: Float, value: float, share: float) -> None:
        show(share, value)
        if follow is not None:
            follow(program.layout(y), float(np.sqrt(value)))

    start = np.zeros(program.size)
    minimum = minimize(
        program, start, iterations, tolerance=tolerance, loosest=forgiven, on_step=on_step
    )
    return program.layout(minimum.x)


class _LayoutProgram:
    """The error and the limits of a layout as functions of its free parameters."""

    def __init__(self, problem: Problem, layout: Layout, slivers: ThinParts, reach: float) -> None:
        self._layout, self._slivers = layout, slivers
        self._cords, spread = shared_parameters(layout)
        # It has a single 1 in each row; on few parameters dense products are faster.
        self._spread: Any = sp.csr_array(spread) if len(spread) > MIN_SPARSE_SIZE else spread
        self.size = spread.shape[1]
        self._objective = Objective(problem, self._cords)
        self._constraints = Constraints(
            problem.surface, problem.depth, problem.limits, self._cords, reach
        )
        self._is_guarded = not slivers(layout)

    def model(self, y: Float) -> QuadraticModel:
        by, at = self._spread.T, self._objective.model(self._spread @ y)
        return QuadraticModel(at.value, by @ at.gradient, by @ (by @ at.hessian).T)

    def value(self, y: Float) -> float:
        return self._objective.value(self._spread @ y)

    def inequalities(self, y: Float) -> tuple[Float, Float]:
        room, rows = self._constraints(self._spread @ y)
        if sp.issparse(self._spread):
            return room, (sp.csr_array(rows) @ self._spread).toarray()
        return room, rows @ self._spread

    def guard(self, y: Float, trial: Float) -> tuple[Float, Float] | None:
        """Return inequalities against a sliver that a trial causes, or None."""
        if not self._is_guarded:
            return None
        limits = self._slivers.guard(self._cords, self._spread @ y, self._spread @ trial)
        return None if limits is None else (limits[0], limits[1] @ self._spread)

    def layout(self, y: Float) -> Layout:
        """Return the layout at parameters y (size,)."""
        return apply_parameters(self._cords, self._spread @ y, self._layout)


def apply_parameters(cords: Sequence[CordParameters], x: Float, layout: Layout) -> Layout:
    """Return the layout with its cords at parameters x (size,), as free as before."""
    parts = np.split(x, np.cumsum([c.size for c in cords[:-1]]))
    moved = zip(cords, parts, layout, strict=True)
    return tuple(replace(place_cord(c, part).sensor(), free=s.free) for c, part, s in moved)
