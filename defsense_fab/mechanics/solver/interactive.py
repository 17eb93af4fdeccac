"""A pose that follows the user's hand: a coarse answer at once, the fine one after it."""

from __future__ import annotations

from collections.abc import Callable

from ...core.arrays import Float
from ..elements.material import Material
from ..elements.point_location import PointLocator
from ..elements.tet10 import QuadraticMesh
from ..loading.boundary_conditions import BoundaryConditions, State, rest
from .load_stepping import Equilibrium, follow
from .newton import System


class Interactive:
    """Two meshes of one body, each with its last equilibrium and its factorisation.

    `conditions(mesh)` gives the boundary conditions of a pose on either mesh; poses of the same
    structure (see `BoundaryConditions.structure`) follow each other without a new analysis.
    """

    def __init__(
        self, coarse: QuadraticMesh, fine: QuadraticMesh, material: Material, threads: int = 1
    ) -> None:
        self._meshes = (coarse, fine)
        self._material, self._threads = material, threads
        self._systems: list[System] = []
        self._states: list[State] = []
        self._locator = PointLocator(coarse)
        self._at = self._locator.find(fine.nodes)

    def edit(
        self,
        conditions: Callable[[QuadraticMesh], BoundaryConditions],
        on_coarse: Callable[[Float], None] | None = None,
        stop: Callable[[], bool] | None = None,
        check: bool = True,
    ) -> Equilibrium:
        """The equilibrium of the fine mesh; `on_coarse` gets u (n, 3) mm on its nodes before.

        The last state is kept where the new one is not reached or `stop` says so.
        """
        goals = [conditions(mesh) for mesh in self._meshes]
        self._prepare(goals)
        coarse = follow(self._systems[0], self._states[0], goals[0], stop=stop, check=False)[-1]
        if coarse.state is None:
            return coarse
        moved = coarse.state.u - self._states[0].u
        change = self._locator.displacement(self._at, moved[None])[0]
        if on_coarse:
            on_coarse(self._states[1].u + change)
        fine = follow(
            self._systems[1], self._states[1], goals[1], stop=stop, check=check, guess=change
        )[-1]
        if fine.state is not None:
            self._states = [coarse.state, fine.state]
        return fine

    def _prepare(self, goals: list[BoundaryConditions]) -> None:
        if self._systems and self._systems[1].structure == goals[1].structure:
            return
        self.close()
        self._systems = [
            System(m, self._material, g, self._threads)
            for m, g in zip(self._meshes, goals, strict=True)
        ]
        self._states = [rest(g, len(m.nodes)) for m, g in zip(self._meshes, goals, strict=True)]

    def close(self) -> None:
        """Release the factorisations."""
        for system in self._systems:
            system.close()
        self._systems = []
