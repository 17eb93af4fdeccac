"""A device's surface in real time: what the live loop calls."""

from __future__ import annotations

import time
from typing import Literal, Protocol

import numpy as np

from ...core.arrays import Float
from .elastic_net import ElasticNet
from .surface_mesh import Attachment, Cage, SurfaceBasis
from .surface_solvers import ArapSolver, ModeSolver, TimeBudget

Mode = Literal["default", "arap", "basis"]

#: Seconds that a frame should take at most: larger meshes get a cage.
FRAME = 0.008
#: Vertices: smaller meshes are solved as they are, without a trial.
_SMALL = 2_000
#: Vertices: larger ones get a cage, without a trial.
_LARGE = 15_000
#: Vertices of a cage.
CAGE = 4_000
_TRIALS = 5  # frames


class Solver(Protocol):
    """What a mode is solved by."""

    rounds: int

    @property
    def name(self) -> str: ...

    def reset(self) -> None: ...

    def solve(self, markers: Float, sd: Float, budget: TimeBudget) -> tuple[Float, Float]: ...


class LiveSurface:
    """Markers to a surface, warm-started from frame to frame; one at a time. `choice` tells in
    words what it is solved by; `rounds` how many rounds the last frame took."""

    def __init__(
        self, solver: Solver, net: ElasticNet, sd: Float, description: str, cage: Cage | None = None
    ) -> None:
        self.description = description
        self._solver, self._sd, self._cage = solver, sd, cage
        self._place = np.empty_like(net.order)
        self._place[net.order] = np.arange(len(net.order))

    def __call__(
        self, markers: Float, sd: Float | None = None, budget: float | None = None
    ) -> Float:
        """Vertices (v, 3) mm of markers (m, 3) mm, NaN: not seen, with standard deviations (m,) mm,
        those of the set-up where not given, in about `budget` seconds: it bounds the rounds."""
        clock = TimeBudget(budget)
        known = self._sd if sd is None else np.asarray(sd, float)
        if markers.shape != (len(self._sd), 3) or known.shape != self._sd.shape:
            raise ValueError(f"surface: there must be {len(self._sd)} markers, (m, 3), and sd (m,)")
        seen = np.isfinite(markers).all(axis=1) & ~np.isnan(known)
        x, rotations = self._solver.solve(
            np.where(seen[:, None], markers, 0.0), np.where(seen, known, np.inf), clock
        )
        x = x[self._place]
        return x if self._cage is None else self._cage.surface(x, rotations[self._place])

    @property
    def rounds(self) -> int:
        """Of the last frame."""
        return self._solver.rounds

    def reset(self) -> None:
        """Begin at rest: the next frame has nothing to do with the last."""
        self._solver.reset()


def make_surface(
    basis: SurfaceBasis, marker_rest: Float, sd: Float, mode: Mode = "default",
    frame: float = FRAME,
) -> LiveSurface:  # fmt: skip
    """Of markers at rest (m, 3) mm, with typical standard deviations (m,) mm. "default": modes of
    the simulated states and beyond them as rigid as possible, "basis": the modes alone, "arap": as
    rigid as possible without them, which is what a basis without states gets. A mesh that this
    machine does not solve in `frame` seconds is moved by a coarser cage."""
    marker_rest, sd = np.asarray(marker_rest, float), np.asarray(sd, float)
    if marker_rest.ndim != 2 or marker_rest.shape[1] != 3 or sd.shape != marker_rest.shape[:1]:
        raise ValueError("surface: markers must have shape (m, 3), sd (m,)")
    count = len(basis.vertices)
    if count <= _LARGE:
        surface = _solved(basis, marker_rest, sd, mode, None)
        taken = _seconds(surface, marker_rest) if count > _SMALL else 0.0
        if taken <= frame:
            return surface
    cage = Cage.of(basis, CAGE)
    return _solved(cage.basis, marker_rest, sd, mode, cage)


def _solved(
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
    whole = "" if cage is None else f" a cage of {len(net.rest):,} vertices, which carries"
    every = len(net.rest) if cage is None else len(cage.corners)
    return LiveSurface(solver, net, sd, f"{solver.name};{whole} {every:,} vertices", cage)


def _seconds(surface: LiveSurface, markers: Float) -> float:
    """A frame takes with two rounds, on this machine, once all is compiled: the least of a few."""
    taken = []
    for _ in range(_TRIALS):
        begun = time.perf_counter()
        surface(markers, budget=0.0)
        taken.append(time.perf_counter() - begun)
    surface.reset()
    return min(taken)
