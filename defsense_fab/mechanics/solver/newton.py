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
INTERMEDIATE_TOLERANCE = 1e-2  # on the way to a load step that matters
#: Forces below those of such a strain count as none: at rest the largest would be rounding.
MIN_STRAIN = 1e-4
MAX_MATRICES = 30
#: After so many matrices a step that is not `FAR` from equilibrium any more goes on; another is
#: given up, since smaller steps are cheaper.
PATIENCE, FAR_RESIDUAL = 12, 0.3
GUESS_PATIENCE = 2  # with a guess that does not lead near at once
#: Shares of the tangent's pointwise negative parts to remove until it is positive definite: all of
#: it is safe, but too stiff where the body is about to crease.
PROJECTION_SHARES = (0.0, 1 / 8, 1.0)
#: So many matrices in a row with all of it removed, none of which halves a residual that is not
#: `FAR`: the step leads to a saddle.
MAX_SLOW_MATRICES = 8
#: A factor is used again as long as each step with it reduces the residual by this factor.
REUSE_REDUCTION = 8.0
#: From so many matrices on, and down to so small a relative residual, patches are solved first,
#: given up when far from equilibrium after so many matrices.
PATCH_AFTER, MIN_PATCH_RESIDUAL, PATCH_PATIENCE = 1, 0.05, 20


class Cancelled(Exception):
    """The caller asked to stop."""


@dataclass(frozen=True)
class Attempt:
    """`state` in equilibrium, or None; `last` is where it ended. `solves` counts linear solves and
    `factors` factorisations of the whole body, those that met no positive pivot included.

    `stable` tells that the last tangent needed no change to be positive definite, which near
    equilibrium is the true Hessian: the state is a minimum of the energy, not a saddle.
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
    """A state with F and the linearised `volume` (m, 4) that its pressures belong to; potential
    energy, nodal forces, reduced gradient, and its size relative to the largest nodal force."""

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
    """Mesh, material and the structure of boundary conditions, with the factorisation kept.

    `loads` are shared where the mesh is a part of the one that they were made for.
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
        self._hinged = any(len(h.free_axes) for h in conditions.handles)
        self._least = MIN_STRAIN * material.shear * mesh.edge_length**2
        self._whole: Any = None
        self.reset()

    def reset(self) -> None:
        """What earlier solves found out, so that the next takes the way that it takes alone."""
        self._share = 0  # of SHARES, where the last tangent was positive definite
        self._missed = False  # whether a lower one was tried in vain

    @cached_property
    def structure(self) -> tuple[object, ...]:
        """What boundary conditions must have in common to use this system."""
        return self._conditions.structure

    @cached_property
    def handle_rotation(self) -> HandleRotation:
        """The predictor's weights."""
        return HandleRotation(self.reduction.active, self._conditions)

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
        force -= self.loads.forces(goal, placed.u, self.loads.pressure(goal, state.u))
        gradient = self.reduction.gradient(placed, force)
        try:
            blocks = self.loads.blocks(goal, state.u)
            self.solver.factor(
                self.reduction.matrix(placed, material, G, 1.0, blocks, None, self.threads)
            )
        except NotPositiveDefinite:
            return Attempt(None, 0, spent + 1, np.inf, np.inf, False, state)
        by = self.solver.solve(-gradient)
        linear = placed.u + self.reduction.displacement_increment(placed, by)
        volume = tet10.volume_ratios(
            G, tet10.deformation_gradient(active, linear, self.threads), self.threads
        )
        placed = self.reduction.move(placed, by)
        attempt = self.equilibrium(placed, stop, tolerance, patience - 1, volume)
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
        """Newton from a state whose prescribed parts are in place.

        `volume` (m, 4) is the volume ratio at the quadrature points that their pressures start
        from; that of the state unless given. `ease` solves patches that hold the method up.
        """
        now = self._evaluate(state, None, volume)
        solves = factors = matrices = crawling = 0
        stable = False
        while not now.is_balanced(tolerance):
            if stop and stop():
                raise Cancelled
            tired = matrices >= patience and now.residual > FAR_RESIDUAL
            spent = tired or crawling >= MAX_SLOW_MATRICES or matrices >= MAX_MATRICES
            if spent or not np.isfinite(now.energy):
                return Attempt(None, solves, factors, now.residual, now.energy, False, now.state)
            if ease and matrices >= PATCH_AFTER and now.residual > MIN_PATCH_RESIDUAL:
                eased = self._solve_patch(now, stop)
                now = self._evaluate(eased) if eased else now
            matrices += 1
            tried, definite = self._factor(now)
            factors += tried
            if not definite:
                return Attempt(None, solves, factors, now.residual, now.energy, False, now.state)
            stable = self._share == 0
            before, again = now.residual, False
            while True:
                new = self._take_step(now, again)
                solves += 1
                if new is None or (again and not new.residual < now.residual):
                    break
                quick = new.residual < now.residual / REUSE_REDUCTION
                now, again = new, True
                if now.is_balanced(tolerance) or not quick:
                    break
            if not again:
                return Attempt(None, solves, factors, now.residual, now.energy, False, now.state)
            slow = PROJECTION_SHARES[self._share] == 1 and before / 2 < now.residual < FAR_RESIDUAL
            crawling = crawling + 1 if slow else 0
        stable = stable or not self.reduction.size
        return Attempt(now.state, solves, factors, now.residual, now.energy, stable, now.state)

    def _solve_patch(self, now: _Iterate, stop: Callable[[], bool] | None) -> State | None:
        """The state with the patch that holds it up, if any, in equilibrium with the rest held."""
        found = find_stuck_patch(self.reduction, now.gradient)
        if found is None:
            return None
        nodes, cells = found
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
        """Whether the true Hessian is positive definite there: a minimum, not a saddle."""
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

    @property
    def has_modified_tangent(self) -> bool:
        """Whether the last tangent was made positive definite by removing a negative part."""
        return self._share > 0

    def _factor(self, now: _Iterate) -> tuple[int, bool]:
        """Factor the tangent with the least share removed that makes it positive definite; returns
        how many were tried, and whether one was."""
        state = now.state
        blocks = self.loads.blocks(state.conditions, state.u)
        lag = self.material.volumetric * (
            now.volume - tet10.volume_ratios(now.F, now.F, self.threads)
        )
        tried, first = 0, self._share
        if not self._missed:
            self._share = max(first - 1, 0)
        self._missed = False
        while True:
            share, second = PROJECTION_SHARES[self._share], None
            if not share:
                second = now.force
                if self._hinged:
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
        self._whole = None
        if skew is not None:
            whole = matrix + sp.triu(matrix, 1).T + self.reduction.reduced(state, skew)
            self._whole = whole.tocsr()
        return tried, True

    def _solve(self, right: Float) -> Float:
        """With the tangent of the last `_factor`; where pressure makes it unsymmetric, by GMRES
        with the factor of its symmetric part as the preconditioner."""
        if self._whole is None:
            return self.solver.solve(right)
        inverse = spl.LinearOperator(self._whole.shape, matvec=self.solver.solve, dtype=float)
        found, failed = spl.gmres(self._whole, right, M=inverse, rtol=1e-8, maxiter=60)
        return self.solver.solve(right) if failed else np.asarray(found)

    def energy(self, state: State, pressure: Float) -> float:
        """Potential energy (N mm) of body and loads, the pressures as dead nodal loads (n, 3) N;
        inf where the material is not defined."""
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
        scale = max(float(np.abs(inner).max()), float(np.abs(outer).max()), self._least)
        residual = float(np.abs(gradient).max(initial=0.0)) / scale
        if not np.isfinite(scale):
            residual = np.inf
        return _Iterate(state, F, volume, energy, force, gradient, residual)

    def _take_step(self, now: _Iterate, whole: bool) -> _Iterate | None:
        """A step with the last factor, or the largest 1/2^k of it that the material is defined
        at; with `whole` all of it or nothing."""
        active = self.reduction.active
        direction, length = self._solve(-now.gradient), 1.0
        while length > 1e-3:
            trial = self.reduction.move(now.state, length * direction)
            F = tet10.deformation_gradient(active, trial.u, self.threads)
            if np.isfinite(tet10.energy(active, self.material, F, self.threads)):
                linear = F
                if self._hinged:  # handles turn by the exponential map
                    u = now.state.u + self.reduction.displacement_increment(
                        now.state, length * direction
                    )
                    linear = tet10.deformation_gradient(active, u, self.threads)
                return self._evaluate(trial, F, tet10.volume_ratios(now.F, linear, self.threads))
            if whole:
                return None
            length /= 2
        return None
