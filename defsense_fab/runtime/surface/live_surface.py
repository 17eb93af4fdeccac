"""Solve a device's surface in real time, for the live loop."""

from __future__ import annotations

import time
from typing import Literal

import numpy as np

from ...core.arrays import Float
from .elastic_net import ElasticNet
from .surface_mesh import Attachment, Cage, SurfaceBasis
from .surface_solvers import ArapSolver, ModeSolver, Solver, TimeBudget

#: How a surface is solved: see `make_surface`.
Mode = Literal["default", "arap", "basis"]

#: Time that a frame should take; larger meshes get a cage.
FRAME_TIME_S = 0.008
_CAGE_VERTICES = 4_000
_MAX_UNTIMED_VERTICES = 2_000  # such meshes are solved directly, without a trial
_MAX_DIRECT_VERTICES = 15_000  # larger meshes get a cage, without a trial
_TRIAL_FRAMES = 5


class LiveSurface:
    """A surface that follows the markers of a device; created by `make_surface`.

    Args:
        solver: The solver.
        net: Half edges of the solved surface.
        sd: Typical standard deviations of the markers (m,), mm.
        description: How the surface is solved.
        cage: The cage that is solved instead of the surface, or None.

    Attributes:
        description: How the surface is solved.
    """

    def __init__(
        self,
        solver: Solver,
        net: ElasticNet,
        sd: Float,
        description: str,
        cage: Cage | None = None,
    ) -> None:
        self.description = description
        self._solver, self._sd, self._cage = solver, sd, cage
        self._position = np.empty_like(net.order)
        self._position[net.order] = np.arange(len(net.order))

    def __call__(
        self, markers: Float, sd: Float | None = None, budget: float | None = None
    ) -> Float:
        """Return the vertices of a frame (v, 3), mm, starting from those of the last.

        Args:
            markers: Marker positions (m, 3), mm; NaN for invisible markers.
            sd: Their standard deviations (m,), mm; by default the typical ones.
            budget: Approximate time, s, which bounds the iterations.

        Raises:
            ValueError: The shapes do not fit the markers.
        """
        clock = TimeBudget(budget)
        used_sd = self._sd if sd is None else np.asarray(sd, float)
        if markers.shape != (len(self._sd), 3) or used_sd.shape != self._sd.shape:
            m = len(self._sd)
            raise ValueError(f"surface: markers must have shape ({m}, 3), and sd ({m},)")
        visible = np.isfinite(markers).all(axis=1) & ~np.isnan(used_sd)
        x, rotations = self._solver.solve(
            np.where(visible[:, None], markers, 0.0), np.where(visible, used_sd, np.inf), clock
        )
        x = x[self._position]
        return x if self._cage is None else self._cage.surface(x, rotations[self._position])

    @property
    def rounds(self) -> int:
        """Number of iterations of the last frame."""
        return self._solver.rounds

    def reset(self) -> None:
        """Start from rest, so that the next frame does not depend on the last."""
        self._solver.reset()


def make_surface(
    basis: SurfaceBasis,
    marker_rest: Float,
    sd: Float,
    mode: Mode = "default",
    frame: float = FRAME_TIME_S,
) -> LiveSurface:
    """Set up the solver of a surface.

    Args:
        basis: The surface with its simulated states.
        marker_rest: Markers at rest (m, 3), mm.
        sd: Their typical standard deviations (m,), mm.
        mode: "default" for modes of the simulated states, and beyond them as rigid as possible;
            "basis" for the modes alone; "arap" for as rigid as possible without modes, which is
            also used without states.
        frame: Time for a frame, s; a mesh that takes longer on this machine is moved by a coarser
            cage.

    Raises:
        ValueError: The shapes of the markers are wrong.
    """
    marker_rest, sd = np.asarray(marker_rest, float), np.asarray(sd, float)
    if marker_rest.ndim != 2 or marker_rest.shape[1] != 3 or sd.shape != marker_rest.shape[:1]:
        raise ValueError("surface: marker_rest must have shape (m, 3), and sd (m,)")
    count = len(basis.vertices)
    if count <= _MAX_DIRECT_VERTICES:
        surface = _with_solver(basis, marker_rest, sd, mode, None)
        seconds = _frame_seconds(surface, marker_rest) if count > _MAX_UNTIMED_VERTICES else 0.0
        if seconds <= frame:
            return surface
    cage = Cage.of(basis, _CAGE_VERTICES)
    return _with_solver(cage.basis, marker_rest, sd, mode, cage)


def _with_solver(
    basis: SurfaceBasis, markers: Float, sd: Float, mode: Mode, cage: Cage | None
) -> LiveSurface:
    net = ElasticNet.of(basis.vertices, basis.triangles, basis.fixed)
    attachment = Attachment.of(markers, net.rest, net.triangles)
    solver: Solver
    if mode == "arap" or not np.abs(basis.states).max(initial=0.0) > 0:
        solver = ArapSolver(net, attachment, basis.size)
    else:
        states = (basis.vertices + basis.states)[:, net.order]
        solver = ModeSolver(net, states, attachment, basis.size, beyond=mode == "default")
    if cage is None:
        description = f"{solver.name}; {len(net.rest):,} vertices"
    else:
        description = (
            f"{solver.name}; a cage of {len(net.rest):,} vertices, which carries"
            f" {len(cage.corners):,} vertices"
        )
    return LiveSurface(solver, net, sd, description, cage)


def _frame_seconds(surface: LiveSurface, markers: Float) -> float:
    """Measure the time of a frame with two iterations, s: the shortest of a few, once compiled."""
    seconds = []
    for _ in range(_TRIAL_FRAMES):
        started_at = time.perf_counter()
        surface(markers, budget=0.0)
        seconds.append(time.perf_counter() - started_at)
    surface.reset()
    return min(seconds)
