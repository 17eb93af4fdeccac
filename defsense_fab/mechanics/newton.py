"""Newton's method for static equilibrium at one set of boundary conditions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl

from ..core.arrays import Float
from . import tet10
from .conditions import BoundaryConditions, State
from .linear_solver import NotPositiveDefinite, make_solver
from .loads import Loads
from .material import Material
from .predictor import Turning
from .reduction import Reduction
from .tet10 import QuadraticMesh

TOLERANCE = 1e-7  # of the residual, relative to the largest nodal force
LOOSE = 1e-2  # on the way to a load step that matters
MAX_ITERATIONS = 30
#: After so many matrices a step that is not `FAR` from equilibrium any more goes on; another is
#: given up, since smaller steps are cheaper.
PATIENCE, FAR = 9, 0.3
GUESS_PATIENCE = 2  # with a guess that does not lead near at once
#: Below this relative residual the true Hessian is used: a projected one has a linear tail.
NEAR = 0.1
#: A factor is used again as long as each step with it reduces the residual by this factor.
REUSE = 8.0


class Cancelled(Exception):
    """The caller asked to stop."""


@dataclass(frozen=True)
class Attempt:
    """`state` in equilibrium, or None; `iterations` counts linear solves, `factors` matrices.

    `stable` tells that the last matrix was the true Hessian and positive definite: the state is a
    minimum of the energy, not a saddle.
    """

    state: State | None
    iterations: int
    factors: int
    residual: float
    energy: float
    stable: bool


class System:
    """Mesh, material and the structure of boundary conditions, with the factorisation kept."""

    def __init__(
        self,
        mesh: QuadraticMesh,
        material: Material,
        conditions: BoundaryConditions,
        threads: int = 1,
    ) -> None:
        self.mesh, self.material, self.threads = mesh, material, threads
        self.structure = conditions.structure
        self.reduction = Reduction(mesh, conditions)
        self.loads = Loads(mesh, conditions)
        self.turning = Turning(self.reduction.active, conditions)
        self.solver = make_solver(threads)
        self._whole: Any = None

    def close(self) -> None:
        self.solver.close()

    def step(
        self,
        state: State,
        goal: BoundaryConditions,
        stop: Callable[[], bool] | None = None,
        guess: Float | None = None,
        tolerance: float = TOLERANCE,
        patience: int = PATIENCE,
    ) -> Attempt:
        """From an equilibrium to the one under `goal`: predictor, then Newton.

        A `guess` (n, 3) mm of the movement takes the predictor's place where it succeeds.
        """
        placed = self.reduction.place(state, goal)
        if guess is not None:
            near = self.reduction.nudge(placed, state.u + guess)
            attempt = self.equilibrium(near, stop, 0, tolerance, GUESS_PATIENCE)
            if attempt.state is not None:
                return attempt
        factors = 0
        if self.reduction.size:
            active, material = self.reduction.active, self.material
            F = tet10.deformation_gradient(active, state.u, self.threads)
            G = self.turning.rotate(F, state, placed)
            now = tet10.deformation_gradient(active, placed.u, self.threads)
            force = tet10.linearised_forces(active, material, G, now, self.threads)
            force -= self.loads.forces(goal, placed.u, self.loads.pressure(goal, state.u))
            gradient = self.reduction.gradient(placed, force)
            try:
                blocks = self.loads.blocks(goal, state.u)
                matrix = self.reduction.matrix(
                    placed, material, G, True, blocks, None, self.threads
                )
                self.solver.factor(matrix)
                factors = 1
                placed = self.reduction.move(placed, self.solver.solve(-gradient))
            except NotPositiveDefinite:
                return Attempt(None, 1, 1, np.inf, np.inf, False)
        return self.equilibrium(placed, stop, factors, tolerance, patience)

    def equilibrium(
        self,
        state: State,
        stop: Callable[[], bool] | None = None,
        factors: int = 0,
        tolerance: float = TOLERANCE,
        patience: int = MAX_ITERATIONS,
    ) -> Attempt:
        """Newton with a line search from a state whose prescribed parts are in place."""
        iterations, relative, stable, project = factors, np.inf, False, True
        value, F, pressure = self._value(state, state.u, None)
        if not np.isfinite(value):
            return Attempt(None, iterations, factors, np.inf, np.inf, False)
        gradient, force, relative = self._residual(state, F, pressure)
        while relative >= tolerance:
            if stop and stop():
                raise Cancelled
            if iterations >= MAX_ITERATIONS or (factors >= patience and relative > FAR):
                return Attempt(None, iterations, factors, relative, value, False)
            project = project and relative >= NEAR
            try:
                stable = self._factor(state, F, force, project)
            except NotPositiveDefinite:
                return Attempt(None, iterations, factors, relative, value, False)
            factors += 1
            first = True
            while True:
                before = relative
                moved = self._search(state, value, pressure, gradient, first)
                iterations += 1
                if moved is None:
                    break
                state, F = moved
                value, _, pressure = self._value(state, state.u, F)
                gradient, force, relative = self._residual(state, F, pressure)
                if relative < tolerance or relative > before / REUSE:
                    break
                first = False
            if moved is None and first:
                return Attempt(None, iterations, factors, relative, value, False)
        return Attempt(state, iterations, factors, relative, value, stable or factors == 0)

    def is_stable(self, state: State) -> bool:
        """Whether the true Hessian is positive definite there: a minimum, not a saddle."""
        if self.reduction.size == 0:
            return True
        F = tet10.deformation_gradient(self.reduction.active, state.u, self.threads)
        pressure = self.loads.pressure(state.conditions, state.u)
        _, force, _ = self._residual(state, F, pressure)
        blocks = self.loads.blocks(state.conditions, state.u)
        true = self.reduction.matrix(state, self.material, F, False, blocks, force, self.threads)
        try:
            self.solver.factor(true)
        except NotPositiveDefinite:
            return False
        return True

    def _factor(self, state: State, F: Float, force: Float, project: bool) -> bool:
        """Factor the tangent; returns whether it is the true one. Raises NotPositiveDefinite."""
        blocks = self.loads.blocks(state.conditions, state.u)
        if not project:
            matrix = self.reduction.matrix(
                state, self.material, F, False, blocks, force, self.threads
            )
            try:
                self.solver.factor(matrix)
            except NotPositiveDefinite:
                project = True
        if project:
            matrix = self.reduction.matrix(
                state, self.material, F, True, blocks, None, self.threads
            )
            self.solver.factor(matrix)
        skew = self.loads.skew(state.conditions, state.u)
        self._whole = None
        if skew is not None:
            whole = matrix + sp.triu(matrix, 1).T + self.reduction.reduced(state, skew)
            self._whole = whole.tocsr()
        return not project

    def _solve(self, right: Float) -> Float:
        """With the tangent of the last `_factor`; where pressure makes it unsymmetric, by GMRES
        with the factor of its symmetric part as the preconditioner."""
        if self._whole is None:
            return self.solver.solve(right)
        inverse = spl.LinearOperator(self._whole.shape, matvec=self.solver.solve, dtype=float)
        found, failed = spl.gmres(self._whole, right, M=inverse, rtol=1e-8, maxiter=60)
        return self.solver.solve(right) if failed else np.asarray(found)

    def _value(self, state: State, u: Float, F: Float | None) -> tuple[float, Float, Float]:
        """Potential energy, F, and the pressure's nodal forces, which a line search freezes."""
        if F is None:
            F = tet10.deformation_gradient(self.reduction.active, u, self.threads)
        pressure = self.loads.pressure(state.conditions, u)
        value = tet10.energy(self.reduction.active, self.material, F, self.threads)
        return value + self.loads.energy(state.conditions, u, pressure), F, pressure

    def _residual(self, state: State, F: Float, pressure: Float) -> tuple[Float, Float, float]:
        """Reduced gradient, nodal forces, and the gradient relative to the largest of them."""
        inner = tet10.forces(self.reduction.active, self.material, F, self.threads)
        outer = self.loads.forces(state.conditions, state.u, pressure)
        force = inner - outer
        gradient = self.reduction.gradient(state, force)
        scale = max(float(np.abs(inner).max()), float(np.abs(outer).max())) or 1.0
        return gradient, force, float(np.abs(gradient).max(initial=0.0)) / scale

    def _search(
        self, state: State, value: float, pressure: Float, gradient: Float, thorough: bool
    ) -> tuple[State, Float] | None:
        """Line search along the solver's direction; with an old factor only the full step."""
        direction = self._solve(-gradient)
        slope = float(gradient @ direction)
        if not (slope < 0 or self._whole is not None):
            return None
        active, length = self.reduction.active, 1.0
        while length > 1e-6:
            trial = self.reduction.move(state, length * direction)
            F = tet10.deformation_gradient(active, trial.u, self.threads)
            new = tet10.energy(active, self.material, F, self.threads)
            new += self.loads.energy(state.conditions, trial.u, pressure)
            # Near convergence the energy no longer resolves the decrease.
            if new <= value + 1e-4 * length * slope + 1e-12 * abs(value):
                return trial, F
            if self._whole is not None and np.isfinite(new):
                # A load that follows the surface has no energy: less residual is as good.
                after = self._residual(trial, F, self.loads.pressure(trial.conditions, trial.u))[0]
                if np.linalg.norm(after) < (1 - 1e-4 * length) * np.linalg.norm(gradient):
                    return trial, F
            if not thorough:
                return None
            length /= 2
        return None
