"""Find the static equilibrium at one set of boundary conditions by Newton's method.

Nearly incompressible bodies make the plain method crawl: a step that keeps the volume to first
order changes it to second order, the bulk modulus turns that into a huge pressure, and the pressure
spoils the next tangent. Therefore the pressure in the tangent's geometric part is a separate
unknown at each quadrature point, updated by the linearized volume (Magisano, Leonetti & Garcea
2017, "How to improve efficiency and robustness of the Newton method in geometrically non-linear
structural problem discretized via displacement-based finite elements"). The equilibrium
is the same, because the residual is the true one. The energy may rise between iterates, so no line
search uses it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl

from ...core.arrays import Float
from ..elements import tet10
from ..elements.material import Material
from ..elements.tet10 import QuadraticMesh
from ..loading.boundary_conditions import BoundaryConditions, State
from ..loading.loads import Loads
from ..loading.reduction import Reduction
from .convergence_aids import HandleRotation, find_stuck_patch
from .linear_solver import NotPositiveDefinite, make_solver

TOLERANCE = 1e-7  # of the residual, relative to the largest nodal force
INTERMEDIATE_TOLERANCE = 1e-2  # of load steps whose result is only the start of the next
#: Forces below those of this strain count as zero: at rest the largest force is rounding error.
MIN_STRAIN = 1e-4
MAX_MATRICES = 30
#: After `PATIENCE` matrices a step continues only if its relative residual is below `FAR_RESIDUAL`;
#: otherwise it is given up, since smaller steps are cheaper.
PATIENCE, FAR_RESIDUAL = 12, 0.3
GUESS_PATIENCE = 2  # the same for a step from a guess
#: Shares of the tangent's pointwise negative parts that are removed until it is positive definite.
#: To remove all is safe, but too stiff where the body is about to crease.
PROJECTION_SHARES = (0.0, 1 / 8, 1.0)
#: A step leads to a saddle after this many matrices in a row with the whole negative part removed,
#: none of which halves a residual below `FAR_RESIDUAL`.
MAX_SLOW_MATRICES = 8
#: A factorization is reused while each step with it reduces the residual by this factor, or while
#: the last reduction, repeated up to `MAX_LAST_STEPS` times, reaches the tolerance: a step costs a
#: tenth of a factorization on 2,500 tets, and a thirtieth on 50,000.
REUSE_REDUCTION, MAX_LAST_STEPS = 8.0, 5
#: Relative residual of the linear solve of a step; what it leaves, the next step removes.
STEP_RTOL = 1e-4
#: Stuck patches are solved first from this many matrices on, while the relative residual is above
#: `MIN_PATCH_RESIDUAL`; a patch is given up after `PATCH_PATIENCE` matrices.
PATCH_AFTER, MIN_PATCH_RESIDUAL, PATCH_PATIENCE = 1, 0.05, 20


class Cancelled(Exception):
    """Raised when the caller's `stop` function returns True."""


@dataclass(frozen=True)
class Attempt:
    """The outcome of one solve.

    Attributes:
        state: The equilibrium, None if it was not reached.
        solves: Number of linear solves.
        factors: Number of factorizations of the whole body, failed ones included.
        residual: Largest component of the reduced gradient, relative to the largest nodal force.
        energy: Potential energy, N mm.
        stable: Whether the last tangent was positive definite without modification. Near
            equilibrium it is the true Hessian, so the state is a minimum of the energy, not a
            saddle.
        last: The last state, whether in equilibrium or not.
    """

    state: State | None
    solves: int
    factors: int
    residual: float
    energy: float
    stable: bool
    last: State


@dataclass(frozen=True)
class _Iterate:
    """A state with its gradients, the linearized volume of its pressures, energy and forces."""

    state: State
    F: Float
    volume: Float
    energy: float
    force: Float
    gradient: Float
    residual: float

    def is_balanced(self, tolerance: float) -> bool:
        return bool(np.isfinite(self.energy) and self.residual < tolerance)


class System:
    """Mesh, material and structure of boundary conditions, with the last factorization.

    Args:
        mesh: Mesh of the body.
        material: Its material.
        conditions: Boundary conditions of the structure to solve; amounts may change later.
        threads: Number of threads.
        loads: Loads of a larger mesh that this one is part of; new ones by default.
    """

    def __init__(
        self,
        mesh: QuadraticMesh,
        material: Material,
        conditions: BoundaryConditions,
        threads: int = 1,
        loads: Loads | None = None,
    ) -> None:
        self.mesh, self.material, self.threads = mesh, material, threads
        self.reduction = Reduction(mesh, conditions)
        self.loads = loads or Loads(mesh, conditions)
        self.solver = make_solver(threads)
        self._conditions = conditions
        self._has_free_rotation = any(len(h.free_axes) for h in conditions.handles)
        self._min_force = MIN_STRAIN * material.shear * mesh.edge_length**2
        self._unsymmetric: Any = None
        self.reset()

    def reset(self) -> None:
        """Forget earlier solves, so that the next solve is the same as without them."""
        self._share = 0  # index of the share that made the last tangent positive definite
        self._missed = False  # whether a lower share failed in the last attempt

    @cached_property
    def structure(self) -> tuple[object, ...]:
        """Key that boundary conditions must share to use this system."""
        return self._conditions.structure

    @cached_property
    def handle_rotation(self) -> HandleRotation:
        """Predictor for turning handles."""
        return HandleRotation(self.reduction.active, self._conditions)

    def close(self) -> None:
        """Release the factorization."""
        self.solver.close()

    def step(
        self,
        state: State,
        goal: BoundaryConditions,
        stop: Callable[[], bool] | None = None,
        guess: Float | None = None,
        tolerance: float = TOLERANCE,
    ) -> Attempt:
        """Step from an equilibrium to the one under other conditions: predictor, then Newton.

        Args:
            state: The equilibrium to start from.
            goal: Conditions of the same structure.
            stop: Returns True to cancel.
            guess: Guessed displacement increment (n, 3) mm, tried instead of the predictor first.
            tolerance: Relative residual of the equilibrium.

        Raises:
            Cancelled: If `stop` returned True.
        """
        placed = self.reduction.place(state, goal)
        active, material = self.reduction.active, self.material
        F = tet10.deformation_gradient(active, state.u, self.threads)
        spent = 0
        if guess is not None:
            near = self.reduction.apply_guess(placed, state.u + guess)
            before = tet10.volume_ratios(F, F, self.threads)
            attempt = self.equilibrium(near, stop, tolerance, GUESS_PATIENCE, before)
            if attempt.state is not None:
                return attempt
            spent = attempt.factors
        if not self.reduction.size:
            return self.equilibrium(placed)
        G = self.handle_rotation.rotate(F, state, placed)
        now = tet10.deformation_gradient(active, placed.u, self.threads)
        force = tet10.linearized_forces(active, material, G, now, self.threads)
        about = self._rotate_fibers(state, placed)
        force -= self.loads.forces(goal, placed.u, self.loads.pressure(goal, state.u), about)
        gradient = self.reduction.gradient(placed, force)
        try:
            blocks = self.loads.blocks(goal, state.u, 1.0, about)
            self.solver.factor(
                self.reduction.matrix(placed, material, G, 1.0, blocks, None, self.threads)
            )
            by = self.solver.solve(-gradient, STEP_RTOL)
        except NotPositiveDefinite:
            return Attempt(None, 0, spent + 1, np.inf, np.inf, False, state)
        linear = placed.u + self.reduction.displacement_increment(placed, by)
        volume = tet10.volume_ratios(
            G, tet10.deformation_gradient(active, linear, self.threads), self.threads
        )
        placed = self.reduction.move(placed, by)
        attempt = self.equilibrium(placed, stop, tolerance, PATIENCE - 1, volume)
        return replace(attempt, solves=attempt.solves + 1, factors=attempt.factors + spent + 1)

    def equilibrium(
        self,
        state: State,
        stop: Callable[[], bool] | None = None,
        tolerance: float = TOLERANCE,
        patience: int = MAX_MATRICES,
        volume: Float | None = None,
        ease: bool = True,
    ) -> Attempt:
        """Run Newton's method from a state whose prescribed parts are in place.

        Args:
            state: The start.
            stop: Returns True to cancel.
            tolerance: Relative residual of the equilibrium.
            patience: Number of matrices after which a distant solve is given up.
            volume: Volume ratios (m, 4) at the quadrature points that the pressures start from; by
                default those of the state.
            ease: Solve stuck patches alone.

        Raises:
            Cancelled: If `stop` returned True.
        """
        now = self._evaluate(state, None, volume)
        solves = factors = matrices = slow_matrices = 0
        stable = False
        while not now.is_balanced(tolerance):
            if stop and stop():
                raise Cancelled
            is_far = matrices >= patience and now.residual > FAR_RESIDUAL
            spent = is_far or slow_matrices >= MAX_SLOW_MATRICES or matrices >= MAX_MATRICES
            if spent or not np.isfinite(now.energy):
                return Attempt(None, solves, factors, now.residual, now.energy, False, now.state)
            if ease and matrices >= PATCH_AFTER and now.residual > MIN_PATCH_RESIDUAL:
                patched = self._solve_patch(now, stop)
                now = self._evaluate(patched) if patched else now
            matrices += 1
            tried, definite = self._factor(now)
            factors += tried
            if not definite:
                return Attempt(None, solves, factors, now.residual, now.energy, False, now.state)
            stable = self._share == 0
            before, is_reused = now.residual, False
            while True:
                new = self._take_step(now, is_reused)
                solves += 1
                if new is None or (is_reused and not new.residual < now.residual):
                    break
                reduction = new.residual / now.residual
                last = new.residual * reduction**MAX_LAST_STEPS if reduction < 1 else np.inf
                is_fast = reduction < 1 / REUSE_REDUCTION or last < tolerance
                now, is_reused = new, True
                if now.is_balanced(tolerance) or not is_fast:
                    break
            if not is_reused:
                return Attempt(None, solves, factors, now.residual, now.energy, False, now.state)
            slow = PROJECTION_SHARES[self._share] == 1 and before / 2 < now.residual < FAR_RESIDUAL
            slow_matrices = slow_matrices + 1 if slow else 0
        stable = stable or not self.reduction.size
        return Attempt(now.state, solves, factors, now.residual, now.energy, stable, now.state)

    def _rotate_fibers(self, state: State, placed: State) -> Float | None:
        """Return the fibers' vectors (p, 3, d) at a state, turned by the handles' rotations."""
        fibers = self.loads.fibers
        if fibers is None:
            return None
        corners = self.loads.mesh.cells[fibers.cell, :4]
        turns = self.handle_rotation.rotations(state, placed, corners, fibers.bary)
        return np.asarray(turns @ fibers.vectors(state.u))

    def _solve_patch(self, now: _Iterate, stop: Callable[[], bool] | None) -> State | None:
        """Return the state with its stuck patch, if any, in equilibrium while the rest is held."""
        stuck = find_stuck_patch(self.reduction, now.gradient)
        if stuck is None:
            return None
        nodes, cells = stuck
        held = replace(
            now.state.conditions,
            fixed=np.flatnonzero(np.logical_not(nodes)),
            handles=(),
            slides=(),
        )
        patch = System(
            self.reduction.active.subset(cells), self.material, held, self.threads, self.loads
        )
        before = State(now.state.u, now.state.rotations[:0], now.state.translations[:0], held)
        try:
            attempt = patch.equilibrium(
                before, stop, INTERMEDIATE_TOLERANCE, PATCH_PATIENCE, ease=False
            )
            if attempt.solves == 0:
                return None
            if attempt.state is None:
                dead = self.loads.pressure(held, before.u)  # one load for both energies
                if not patch.energy(attempt.last, dead) < patch.energy(before, dead):
                    return None
        finally:
            patch.close()
        return replace(now.state, u=attempt.last.u)

    def is_stable(self, state: State) -> bool:
        """Return whether the true Hessian is positive definite: a minimum, not a saddle."""
        if self.reduction.size == 0:
            return True
        now = self._evaluate(state)
        blocks = self.loads.blocks(state.conditions, state.u)
        true = self.reduction.matrix(
            state, self.material, now.F, 0.0, blocks, now.force, self.threads
        )
        try:
            self.solver.factor(true)
        except NotPositiveDefinite:
            return False
        return True

    def _factor(self, now: _Iterate) -> tuple[int, bool]:
        """Factor the tangent with the smallest share removed that makes it positive definite.

        Returns:
            The number of factorizations tried, and whether the last one succeeded.
        """
        state = now.state
        lag = self.material.volumetric * (
            now.volume - tet10.volume_ratios(now.F, now.F, self.threads)
        )
        tried, first = 0, self._share
        if not self._missed:
            self._share = max(first - 1, 0)
        self._missed = False
        while True:
            share, second = PROJECTION_SHARES[self._share], None
            blocks = self.loads.blocks(state.conditions, state.u, share)
            if not share:
                second = now.force
                if self._has_free_rotation:
                    second = second + tet10.pressure_forces(self.reduction.active, lag, now.F)
            matrix = self.reduction.matrix(
                state, self.material, now.F, share, blocks, second, self.threads, lag
            )
            tried += 1
            try:
                self.solver.factor(matrix)
                break
            except NotPositiveDefinite:
                if share == 1:
                    return tried, False
                self._share += 1
                self._missed = self._share == first
        skew = self.loads.skew(state.conditions, state.u)
        self._unsymmetric = None
        if skew is not None:
            whole = matrix + sp.triu(matrix, 1).T + self.reduction.reduced(state, skew)
            self._unsymmetric = whole.tocsr()
        return tried, True

    def _solve(self, right: Float) -> Float:
        """Solve with the tangent of the last `_factor`.

        If pressure makes the tangent unsymmetric, GMRES solves with the factorization of the
        symmetric part as its preconditioner.
        """
        if self._unsymmetric is None:
            return self.solver.solve(right, STEP_RTOL)
        inverse = spl.LinearOperator(self._unsymmetric.shape, matvec=self.solver.solve, dtype=float)
        solution, status = spl.gmres(self._unsymmetric, right, M=inverse, rtol=1e-8, maxiter=60)
        return self.solver.solve(right) if status else np.asarray(solution)

    def energy(self, state: State, pressure: Float) -> float:
        """Return the potential energy of body and loads, N mm.

        Args:
            state: The state.
            pressure: Nodal forces (n, 3) N of the pressures, which count as dead loads.

        Returns:
            The energy, infinite where the material is not defined.
        """
        F = tet10.deformation_gradient(self.reduction.active, state.u, self.threads)
        stored = tet10.energy(self.reduction.active, self.material, F, self.threads)
        return stored + self.loads.energy(state.conditions, state.u, pressure)

    def _evaluate(
        self, state: State, F: Float | None = None, volume: Float | None = None
    ) -> _Iterate:
        active = self.reduction.active
        if F is None:
            F = tet10.deformation_gradient(active, state.u, self.threads)
        if volume is None:
            volume = tet10.volume_ratios(F, F, self.threads)
        pressure = self.loads.pressure(state.conditions, state.u)
        energy = tet10.energy(active, self.material, F, self.threads)
        energy += self.loads.energy(state.conditions, state.u, pressure)
        inner = tet10.forces(active, self.material, F, self.threads)
        outer = self.loads.forces(state.conditions, state.u, pressure)
        force = inner - outer
        gradient = self.reduction.gradient(state, force)
        scale = max(float(np.abs(inner).max()), float(np.abs(outer).max()), self._min_force)
        residual = float(np.abs(gradient).max(initial=0.0)) / scale
        if not np.isfinite(scale):
            residual = np.inf
        return _Iterate(state, F, volume, energy, force, gradient, residual)

    def _take_step(self, now: _Iterate, whole: bool) -> _Iterate | None:
        """Take the Newton step, or the largest 1/2^k of it at which the material is defined.

        With `whole` only the full step is taken. No step is taken if the matrix turns out not to be
        positive definite.
        """
        active = self.reduction.active
        try:
            direction, length = self._solve(-now.gradient), 1.0
        except NotPositiveDefinite:
            return None
        while length > 1e-3:
            trial = self.reduction.move(now.state, length * direction)
            F = tet10.deformation_gradient(active, trial.u, self.threads)
            if np.isfinite(tet10.energy(active, self.material, F, self.threads)):
                linear = F
                if self._has_free_rotation:  # handles turn by the exponential map
                    u = now.state.u + self.reduction.displacement_increment(
                        now.state, length * direction
                    )
                    linear = tet10.deformation_gradient(active, u, self.threads)
                return self._evaluate(trial, F, tet10.volume_ratios(now.F, linear, self.threads))
            if whole:
                return None
            length /= 2
        return None
