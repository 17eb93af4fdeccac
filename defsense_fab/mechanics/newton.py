"""Static equilibrium by load stepping and Newton's method with a line search.

Rigid handles are eliminated exactly: every nodal coordinate is prescribed, a free unknown, or
one of a handle's three free translations, so the reduced system is an index map away.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import scipy.sparse as sp

from ..core.arrays import Float, Int
from . import tet10
from .linear_solver import NotPositiveDefinite, SymmetricSolver
from .material import NeoHookean
from .pose import BoundaryConditions, rotation_matrix
from .tet10 import QuadraticMesh

TOLERANCE = 1e-7  # of the residual, relative to the largest nodal force
MAX_ITERATIONS = 40
SMALLEST_STEP = 1 / 256


@dataclass(frozen=True)
class Equilibrium:
    """`u` (n, 3) mm at the fraction `amplitude` of the load, or None where it was not reached."""

    u: Float | None
    amplitude: float
    iterations: int
    steps: int
    residual: float
    energy: float

    @property
    def converged(self) -> bool:
        return self.u is not None


def solve_ramp(
    mesh: QuadraticMesh,
    material: NeoHookean,
    conditions: BoundaryConditions,
    fractions: Sequence[float],
    on_step: Callable[[float], None] | None = None,
) -> list[Equilibrium]:
    """Equilibria at increasing load `fractions`, from rest; stops at the first not reached.

    The last record then has no field and tells the largest amplitude that was reached.
    """
    system = _System(mesh, material, conditions)
    u, at, results = np.zeros_like(mesh.nodes), 0.0, []
    step = min(0.25, fractions[0])
    try:
        for target in fractions:
            iterations = steps = 0
            residual = 0.0
            while at < target - 1e-12:
                goal = min(at + step, target)
                attempt = system.step(u, at, goal)
                iterations += attempt.iterations
                if attempt.u is None:
                    step = (goal - at) / 2
                    if step < SMALLEST_STEP:
                        results.append(Equilibrium(None, at, iterations, steps, np.inf, np.inf))
                        return results
                    continue
                u, at, residual = attempt.u, goal, attempt.residual
                steps += 1
                step *= 1.5 if attempt.iterations < 8 else 1.0
                if on_step:
                    on_step(at)
            e = tet10.energy(mesh, material, u)
            results.append(Equilibrium(u.copy(), at, iterations, steps, residual, e))
    finally:
        system.close()
    return results


@dataclass(frozen=True)
class _Attempt:
    u: Float | None
    iterations: int
    residual: float


class _System:
    """The reduced unknowns of one set of boundary conditions and their factorisation."""

    def __init__(
        self, mesh: QuadraticMesh, material: NeoHookean, conditions: BoundaryConditions
    ) -> None:
        self.mesh, self.material, self.conditions = mesh, material, conditions
        kind = np.zeros(len(mesh.nodes), int)
        kind[conditions.fixed] = -1
        for m in conditions.motions:
            kind[m.nodes] = -1
        index = np.full((len(mesh.nodes), 3), -1)
        free = np.flatnonzero(kind == 0)
        index[free] = np.arange(3 * len(free)).reshape(-1, 3)
        self.size = 3 * len(free)
        for m in conditions.motions:
            if m.translation is None:
                index[m.nodes] = np.arange(self.size, self.size + 3)
                self.size += 3
        self.index: Int = index
        self._row = index[mesh.cells].reshape(len(mesh.cells), 30)
        self._build_pattern()
        self.solver = SymmetricSolver()

    def _build_pattern(self) -> None:
        r = np.repeat(self._row, 30, axis=1).ravel()
        c = np.tile(self._row, (1, 30)).ravel()
        keep = (r >= 0) & (c >= r)
        keys = r[keep] * self.size + c[keep]
        unique, inverse = np.unique(keys, return_inverse=True)
        self._slot = np.full(len(r), -1)
        self._slot[keep] = inverse
        rows, columns = np.divmod(unique, self.size)
        self._indices = columns.astype(np.int32)
        self._indptr = np.searchsorted(rows, np.arange(self.size + 1)).astype(np.int32)

    def close(self) -> None:
        self.solver.close()

    def _matrix(self, elements: Float) -> Any:
        data = np.zeros(len(self._indices))
        _scatter(elements.reshape(-1), self._slot, data)
        return sp.csr_matrix((data, self._indices, self._indptr), shape=(self.size, self.size))

    def _reduce(self, force: Float) -> Float:
        keep = self.index >= 0
        return np.asarray(np.bincount(self.index[keep], force[keep], minlength=self.size), float)

    def _expand(self, q: Float) -> Float:
        return np.asarray(np.where(self.index >= 0, q[self.index], 0.0))

    def _prescribed(self, u: Float, start: float, goal: float) -> Float:
        """Exact increment (n, 3) of the handles between two amplitudes."""
        delta = np.zeros_like(u)
        for m in self.conditions.motions:
            arm = self.mesh.nodes[m.nodes] - m.center
            turn = rotation_matrix(goal * m.rotation) - rotation_matrix(start * m.rotation)
            delta[m.nodes] = arm @ turn.T
            if m.translation is not None:
                delta[m.nodes] += (goal - start) * m.translation
        return delta

    def step(self, u: Float, start: float, goal: float) -> _Attempt:
        """Move the handles from one amplitude to the next: tangent predictor, then Newton."""
        mesh, material = self.mesh, self.material
        delta = self._prescribed(u, start, goal)
        if self.size == 0:  # every node is prescribed: nothing to solve, but it may be impossible
            possible = np.isfinite(tet10.energy(mesh, material, u + delta))
            return _Attempt(u + delta if possible else None, 1, 0.0)
        elements = tet10.stiffness(mesh, material, u, True)
        local = delta[mesh.cells].reshape(len(mesh.cells), 30)
        push = np.einsum("eij,ej->ei", elements, local).reshape(-1, 10, 3)
        force = np.zeros_like(u)
        np.add.at(force, mesh.cells, push)
        try:
            q = self.solver.solve(self._matrix(elements), -self._reduce(force))
        except NotPositiveDefinite:
            return _Attempt(None, 1, np.inf)
        return self._newton(u + delta + self._expand(q))

    def _newton(self, u: Float) -> _Attempt:
        mesh, material = self.mesh, self.material
        value = tet10.energy(mesh, material, u)
        if not np.isfinite(value):
            return _Attempt(None, 1, np.inf)
        project = True
        relative = np.inf
        for iteration in range(1, MAX_ITERATIONS + 1):
            force = tet10.forces(mesh, material, u)
            gradient = self._reduce(force)
            scale = float(np.abs(force).max()) or 1.0
            relative = float(np.abs(gradient).max()) / scale
            if relative < TOLERANCE:
                return _Attempt(u, iteration, relative)
            if relative < 0.05:  # an always projected Newton has a linear tail
                project = False
            try:
                elements = tet10.stiffness(mesh, material, u, project)
                direction = self.solver.solve(self._matrix(elements), -gradient)
            except NotPositiveDefinite:
                if project:
                    return _Attempt(None, iteration, relative)
                project = True
                elements = tet10.stiffness(mesh, material, u, True)
                direction = self.solver.solve(self._matrix(elements), -gradient)
            slope = float(gradient @ direction)
            if slope >= 0:
                return _Attempt(None, iteration, relative)
            length, full = 1.0, self._expand(direction)
            while True:
                trial = u + length * full
                new = tet10.energy(mesh, material, trial)
                # Near convergence the energy no longer resolves the decrease.
                if new <= value + 1e-4 * length * slope + 1e-12 * abs(value):
                    break
                length /= 2
                if length < 1e-6:
                    return _Attempt(None, iteration, relative)
            u, value = trial, new
        return _Attempt(None, MAX_ITERATIONS, relative)


@numba.njit(cache=True)
def _scatter(values, slot, data):  # type: ignore[no-untyped-def]
    for i in range(len(values)):
        if slot[i] >= 0:
            data[slot[i]] += values[i]
