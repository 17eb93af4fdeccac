"""Newton's method for static equilibrium at one set of boundary conditions.

Nearly incompressible bodies make the plain method crawl: a step that keeps the volume to first
order changes it to second order, the bulk modulus makes a huge pressure of that, and the pressure
spoils the next tangent. So the pressure in the tangent's geometric part is an unknown of its own at
each quadrature point, moved along by the linearised volume (Magisano, Leonetti & Garcea 2017, "How
to improve efficiency and robustness of the Newton method in geometrically non-linear structural
problem discretized via displacement-based finite elements"). The equilibrium is the same, since the
residual is the true one; the energy may rise on the way, so no line search looks at it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
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
from .patch import stuck_patch
from .predictor import Turning
from .reduction import Reduction
from .tet10 import QuadraticMesh

TOLERANCE = 1e-7  # of the residual, relative to the largest nodal force
LOOSE = 1e-2  # on the way to a load step that matters
MAX_ITERATIONS = 30
#: After so many matrices a step that is not `FAR` from equilibrium any more goes on; another is
#: given up, since smaller steps are cheaper.
PATIENCE, FAR = 12, 0.3
GUESS_PATIENCE = 2  # with a guess that does not lead near at once
#: Shares of the tangent's pointwise negative parts to remove until it is positive definite: all of
#: it is safe, but too stiff where the body is about to crease.
SHARES = (0.0, 1 / 8, 1.0)
#: A factor is used again as long as each step with it reduces the residual by this factor.
REUSE = 8.0
#: From so many matrices on, and down to so small a relative residual, patches are solved first,
#: with so many matrices at most.
PATCH_AFTER, PATCH_FAR, PATCH_PATIENCE = 2, 0.05, 20


class Cancelled(Exception):
    """The caller asked to stop."""


@dataclass(frozen=True)
class Attempt:
    """`state` in equilibrium, or None; `last` is where it ended; `iterations` counts linear solves,
    `factors` matrices.

    `stable` tells that the last matrix was the true Hessian and positive definite: the state is a
    minimum of the energy, not a saddle.
    """

    state: State | None
    iterations: int
    factors: int
    residual: float
    energy: float
    stable: bool
    last: State


class System:
    """Mesh, material and the structure of boundary conditions, with the factorisation kept."""

    def __init__(
        self,
        mesh: QuadraticMesh,
        material: Material,
        conditions: BoundaryConditions,
        threads: int = 1,
        loads: Loads | None = None,
    ) -> None:
        self.mesh, self.material, self.threads = mesh, material, threads
        self.structure = conditions.structure
        self.reduction = Reduction(mesh, conditions)
        self.loads = loads or Loads(mesh, conditions)
        self._patch = loads is not None
        self.turning = Turning(self.reduction.active, conditions)
        self.solver = make_solver(threads)
        self._whole: Any = None
        self._share = 0  # of SHARES, where the last tangent was positive definite

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
        active, material = self.reduction.active, self.material
        F = tet10.deformation_gradient(active, state.u, self.threads)
        if guess is not None:
            near = self.reduction.nudge(placed, state.u + guess)
            before = tet10.volume(F, F, self.threads)
            attempt = self.equilibrium(near, stop, 0, tolerance, GUESS_PATIENCE, before)
            if attempt.state is not None:
                return attempt
        if not self.reduction.size:
            return self.equilibrium(placed)
        G = self.turning.rotate(F, state, placed)
        now = tet10.deformation_gradient(active, placed.u, self.threads)
        force = tet10.linearised_forces(active, material, G, now, self.threads)
        force -= self.loads.forces(goal, placed.u, self.loads.pressure(goal, state.u))
        gradient = self.reduction.gradient(placed, force)
        try:
            blocks = self.loads.blocks(goal, state.u)
            self.solver.factor(
                self.reduction.matrix(placed, material, G, 1.0, blocks, None, self.threads)
            )
        except NotPositiveDefinite:
            return Attempt(None, 1, 1, np.inf, np.inf, False, state)
        placed = self.reduction.move(placed, self.solver.solve(-gradient))
        F = tet10.deformation_gradient(active, placed.u, self.threads)
        volume = tet10.volume(G, F, self.threads)
        return self.equilibrium(placed, stop, 1, tolerance, patience, volume)

    def equilibrium(
        self,
        state: State,
        stop: Callable[[], bool] | None = None,
        factors: int = 0,
        tolerance: float = TOLERANCE,
        patience: int = MAX_ITERATIONS,
        volume: Float | None = None,
    ) -> Attempt:
        """Newton from a state whose prescribed parts are in place.

        `volume` (m, 4) is the volume ratio at the quadrature points that their pressures start
        from; that of the state unless given.
        """
        iterations, stable = 0, False
        F = tet10.deformation_gradient(self.reduction.active, state.u, self.threads)
        if volume is None:
            volume = tet10.volume(F, F, self.threads)
        value, gradient, force, relative = self._evaluate(state, F)
        while not (np.isfinite(value) and relative < tolerance):
            if stop and stop():
                raise Cancelled
            tired = factors >= patience and relative > FAR
            if tired or iterations >= MAX_ITERATIONS or not np.isfinite(value):
                return Attempt(None, iterations, factors, relative, value, False, state)
            if factors >= PATCH_AFTER and relative > PATCH_FAR and not self._patch:
                eased = self._ease(state, gradient, stop)
                if eased is not None:
                    state = eased
                    F = tet10.deformation_gradient(self.reduction.active, state.u, self.threads)
                    volume = tet10.volume(F, F, self.threads)
                    value, gradient, force, relative = self._evaluate(state, F)
            try:
                stable = self._factor(state, F, force, volume)
            except NotPositiveDefinite:
                return Attempt(None, iterations, factors, relative, value, False, state)
            factors += 1
            again = False
            while True:
                moved = self._move(state, self._solve(-gradient), again)
                iterations += 1
                if moved is None:
                    break
                volume = tet10.volume(F, moved[1], self.threads)
                (state, F), before = moved, relative
                value, gradient, force, relative = self._evaluate(state, F)
                if relative < tolerance or relative > before / REUSE:
                    break
                again = True
            if moved is None and not again:
                return Attempt(None, iterations, factors, relative, value, False, state)
        return Attempt(state, iterations, factors, relative, value, stable or factors == 0, state)

    def _ease(self, state: State, gradient: Float, stop: Callable[[], bool] | None) -> State | None:
        """The state with the patch that holds it up, if any, in equilibrium with the rest held."""
        found = stuck_patch(self.reduction, gradient)
        if found is None:
            return None
        nodes, cells = found
        held = replace(
            state.conditions, fixed=np.flatnonzero(np.logical_not(nodes)), handles=(), slides=()
        )
        patch = System(
            self.reduction.active.subset(cells), self.material, held, self.threads, self.loads
        )
        before = State(state.u, state.turns[:0], state.shifts[:0], held)
        try:
            attempt = patch.equilibrium(before, stop, 0, LOOSE, PATCH_PATIENCE)
        finally:
            patch.close()
        worse = attempt.state is None and not attempt.energy < patch.energy(before)
        return None if worse or attempt.iterations == 0 else replace(state, u=attempt.last.u)

    def is_stable(self, state: State) -> bool:
        """Whether the true Hessian is positive definite there: a minimum, not a saddle."""
        if self.reduction.size == 0:
            return True
        F = tet10.deformation_gradient(self.reduction.active, state.u, self.threads)
        force = self._evaluate(state, F)[2]
        blocks = self.loads.blocks(state.conditions, state.u)
        true = self.reduction.matrix(state, self.material, F, 0.0, blocks, force, self.threads)
        try:
            self.solver.factor(true)
        except NotPositiveDefinite:
            return False
        return True

    def _factor(self, state: State, F: Float, force: Float, volume: Float) -> bool:
        """Factor the tangent; returns whether nothing was removed. Raises NotPositiveDefinite."""
        blocks = self.loads.blocks(state.conditions, state.u)
        lag = self.material.volumetric * (volume - tet10.volume(F, F, self.threads))
        self._share = max(self._share - 1, 0)
        while True:
            share = SHARES[self._share]
            second = None if share else force
            matrix = self.reduction.matrix(
                state, self.material, F, share, blocks, second, self.threads, lag
            )
            try:
                self.solver.factor(matrix)
                break
            except NotPositiveDefinite:
                if share == 1:
                    raise
                self._share += 1
        skew = self.loads.skew(state.conditions, state.u)
        self._whole = None
        if skew is not None:
            whole = matrix + sp.triu(matrix, 1).T + self.reduction.reduced(state, skew)
            self._whole = whole.tocsr()
        return self._share == 0

    def _solve(self, right: Float) -> Float:
        """With the tangent of the last `_factor`; where pressure makes it unsymmetric, by GMRES
        with the factor of its symmetric part as the preconditioner."""
        if self._whole is None:
            return self.solver.solve(right)
        inverse = spl.LinearOperator(self._whole.shape, matvec=self.solver.solve, dtype=float)
        found, failed = spl.gmres(self._whole, right, M=inverse, rtol=1e-8, maxiter=60)
        return self.solver.solve(right) if failed else np.asarray(found)

    def energy(self, state: State) -> float:
        """Potential energy of body and loads, N mm; inf where the material is not defined."""
        F = tet10.deformation_gradient(self.reduction.active, state.u, self.threads)
        return self._evaluate(state, F)[0]

    def _evaluate(self, state: State, F: Float) -> tuple[float, Float, Float, float]:
        """Potential energy, reduced gradient, nodal forces, and the gradient relative to the
        largest of them."""
        pressure = self.loads.pressure(state.conditions, state.u)
        value = tet10.energy(self.reduction.active, self.material, F, self.threads)
        value += self.loads.energy(state.conditions, state.u, pressure)
        inner = tet10.forces(self.reduction.active, self.material, F, self.threads)
        outer = self.loads.forces(state.conditions, state.u, pressure)
        force = inner - outer
        gradient = self.reduction.gradient(state, force)
        scale = max(float(np.abs(inner).max()), float(np.abs(outer).max())) or 1.0
        return value, gradient, force, float(np.abs(gradient).max(initial=0.0)) / scale

    def _move(self, state: State, direction: Float, whole: bool) -> tuple[State, Float] | None:
        """The state moved along the direction, or by the largest 1/2^k of it that the material
        is defined at; with `whole` all of it or nothing."""
        length = 1.0
        while length > 1e-3:
            trial = self.reduction.move(state, length * direction)
            F = tet10.deformation_gradient(self.reduction.active, trial.u, self.threads)
            if np.isfinite(tet10.energy(self.reduction.active, self.material, F, self.threads)):
                return trial, F
            if whole:
                return None
            length /= 2
        return None
