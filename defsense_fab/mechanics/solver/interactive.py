"""Solve poses while the user changes them: a coarse answer at once, then the fine one."""

from __future__ import annotations

from collections.abc import Callable

from ...core.arrays import Float
from ..elements.material import Material
from ..elements.point_location import PointLocator
from ..elements.tet10 import QuadraticMesh
from ..loading.boundary_conditions import BoundaryConditions, State, rest_state
from .load_stepping import Equilibrium, Status, Stepping, follow
from .newton import TOLERANCE, System

#: Relative residual that is enough for display: errors of hundredths of a micrometer on bodies of
#: a hand's size, for about half the work.
VISUAL_TOLERANCE = 1e-4
Stop = Callable[[], bool]


class InteractiveSolver:
    """Two meshes of one body, each with its last equilibrium and its factorization.

    Poses of the same structure (see `BoundaryConditions.structure`) need no new analysis.

    Args:
        coarse: Mesh for quick answers; None for fine answers only.
        fine: Mesh of the result.
        material: Material of both.
        threads: Number of threads.
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
        self._states: list[State] = []  # of one pose, the fine mesh last
        # State of the coarse mesh, which runs ahead of the fine one while the user drags.
        self._coarse_ahead: State | None = None
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
        """Solve a pose from the last one, or from rest if it is not reached from there.

        The last state is kept if the new one is not reached or the solve is stopped. Once the
        coarse mesh does not converge, only fine answers follow.

        Args:
            conditions: Function that gives the pose's boundary conditions on a mesh.
            on_coarse: Called with the coarse answer, displacements (n, 3) mm of the fine nodes.
            stop: Returns True to cancel.
            check: Check the fine answer, see `load_stepping.follow`.
            newer: Returns True to cancel the fine answer only, when a newer pose waits.
            from_rest: Solve from rest at once; the `amplitude` is then the share reached.
            tolerance: Relative residual of the fine answer.

        Returns:
            The equilibrium of the fine mesh.
        """
        goals = [conditions(mesh) for mesh in self._meshes]
        self._prepare(goals)
        previous = self._states, self._coarse_ahead
        if not from_rest:
            result = self._follow(goals, on_coarse, stop, check, newer, tolerance)
            moved = any(state.u.any() for state in self._states)
            if result.status is not Status.NOT_REACHED or not moved:
                return result
        self._restart()
        result = self._follow(goals, on_coarse, stop, check, newer, tolerance)
        if result.state is None:
            self._states, self._coarse_ahead = previous
        return result

    @property
    def displacements(self) -> tuple[Float, ...]:
        """Displacements (n, 3) mm of the last equilibrium on each mesh, the fine mesh last."""
        return tuple(state.u for state in self._states)

    def close(self) -> None:
        """Release the factorizations."""
        for system in self._systems:
            system.close()
        self._systems = []

    def _restart(self) -> None:
        goals = [state.conditions for state in self._states]
        sizes = [len(mesh.nodes) for mesh in self._meshes]
        self._states = [rest_state(g, n) for g, n in zip(goals, sizes, strict=True)]
        self._coarse_ahead = self._states[0] if len(self._states) > 1 else None

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
        if self._coarse_ahead is not None:
            visual = Stepping(check=False, tolerance=VISUAL_TOLERANCE)
            coarse = follow(
                self._systems[0], self._coarse_ahead, goals[0], stop=stop, stepping=visual
            )[-1]
            if coarse.status is Status.CANCELLED:
                return coarse
            ahead = self._coarse_ahead = coarse.state  # None if it did not converge
        if ahead is not None:
            moved = ahead.u - self._states[0].u
            guess = self._locator.displacement(self._at, moved[None])[0]
            if on_coarse:
                on_coarse(self._states[-1].u + guess)

        def ended() -> bool:
            return bool((stop and stop()) or (newer and newer()))

        exact = Stepping(check, guess, tolerance=tolerance)
        fine = follow(self._systems[-1], self._states[-1], goals[-1], stop=ended, stepping=exact)[
            -1
        ]
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
        self._coarse_ahead = self._states[0] if len(goals) > 1 else None
