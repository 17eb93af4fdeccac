"""A pose that follows the user's hand: a coarse answer at once, the fine one after it."""

from __future__ import annotations

from collections.abc import Callable

from ...core.arrays import Float
from ..elements.material import Material
from ..elements.point_location import PointLocator
from ..elements.tet10 import QuadraticMesh
from ..loading.boundary_conditions import BoundaryConditions, State, rest_state
from .load_stepping import Equilibrium, Status, follow
from .newton import TOLERANCE, System

#: Tolerance that is enough for the eye: hundredths of a micrometre on bodies of a hand's size, for
#: about half the work.
VISUAL_TOLERANCE = 1e-4
Stop = Callable[[], bool]


class InteractiveSolver:
    """Two meshes of one body, each with its last equilibrium and its factorisation.

    `conditions(mesh)` gives the boundary conditions of a pose on either mesh; poses of the same
    structure (see `BoundaryConditions.structure`) follow each other without a new analysis. Without
    a `coarse` mesh, or once it cannot follow, there are fine answers alone.
    """

    def __init__(
        self,
        coarse: QuadraticMesh | None,
        fine: QuadraticMesh,
        material: Material,
        threads: int = 1,
    ) -> None:
        self._meshes = (fine,) if coarse is None else (coarse, fine)
        self._material, self._threads = material, threads
        self._systems: list[System] = []
        self._states: list[State] = []  # of one pose, the fine one last
        self._near: State | None = None  # of the coarse mesh, which is ahead while a hand moves
        if coarse is not None:
            self._locator = PointLocator(coarse)
            self._at = self._locator.find(fine.nodes)

    def edit(
        self,
        conditions: Callable[[QuadraticMesh], BoundaryConditions],
        on_coarse: Callable[[Float], None] | None = None,
        stop: Stop | None = None,
        check: bool = True,
        newer: Stop | None = None,
        from_rest: bool = False,
        tolerance: float = TOLERANCE,
    ) -> Equilibrium:
        """The equilibrium of the fine mesh; `on_coarse` gets u (n, 3) mm on its nodes before.

        Where it is not reached from the last one, it is sought from rest, as it is at once with
        `from_rest`: the `amplitude` is then how far the pose came. The last state is kept where the
        new one is not reached or `stop` says so; `newer` stops the fine answer alone, so that a
        hand is followed; `tolerance` as `follow` has it, for the fine mesh.
        """
        goals = [conditions(mesh) for mesh in self._meshes]
        self._prepare(goals)
        kept = self._states, self._near
        if not from_rest:
            found = self._follow(goals, on_coarse, stop, check, newer, tolerance)
            moved = any(state.u.any() for state in self._states)
            if found.status is not Status.NOT_REACHED or not moved:
                return found
        self._restart()
        found = self._follow(goals, on_coarse, stop, check, newer, tolerance)
        if found.state is None:
            self._states, self._near = kept
        return found

    @property
    def displacements(self) -> tuple[Float, ...]:
        """Displacements (n, 3) mm of the last equilibrium on each mesh, the fine mesh last."""
        return tuple(state.u for state in self._states)

    def close(self) -> None:
        """Release the factorisations."""
        for system in self._systems:
            system.close()
        self._systems = []

    def _restart(self) -> None:
        goals = [state.conditions for state in self._states]
        sizes = [len(mesh.nodes) for mesh in self._meshes]
        self._states = [rest_state(g, n) for g, n in zip(goals, sizes, strict=True)]
        self._near = self._states[0] if len(self._states) > 1 else None

    def _follow(
        self,
        goals: list[BoundaryConditions],
        on_coarse: Callable[[Float], None] | None,
        stop: Stop | None,
        check: bool,
        newer: Stop | None,
        tolerance: float,
    ) -> Equilibrium:
        ahead, guess = None, None
        if self._near is not None:
            coarse = follow(
                self._systems[0],
                self._near,
                goals[0],
                stop=stop,
                check=False,
                tolerance=VISUAL_TOLERANCE,
            )[-1]
            if coarse.status is Status.CANCELLED:
                return coarse
            ahead = self._near = coarse.state  # None: it cannot follow, and is left out
        if ahead is not None:
            moved = ahead.u - self._states[0].u
            guess = self._locator.displacement(self._at, moved[None])[0]
            if on_coarse:
                on_coarse(self._states[-1].u + guess)

        def ended() -> bool:
            return bool((stop and stop()) or (newer and newer()))

        fine = follow(
            self._systems[-1], self._states[-1], goals[-1], stop=ended, check=check, guess=guess,
            tolerance=tolerance,
        )[-1]  # fmt: skip
        if fine.state is not None:
            coarse_state = self._states[:-1] if ahead is None else [ahead]
            self._states = [*coarse_state, fine.state]
        return fine

    def _prepare(self, goals: list[BoundaryConditions]) -> None:
        if self._systems and self._systems[-1].structure == goals[-1].structure:
            return
        self.close()
        self._systems = [
            System(m, self._material, g, self._threads)
            for m, g in zip(self._meshes, goals, strict=True)
        ]
        self._states = [
            rest_state(g, len(m.nodes)) for m, g in zip(self._meshes, goals, strict=True)
        ]
        self._near = self._states[0] if len(goals) > 1 else None
