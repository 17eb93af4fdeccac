"""As-rigid-as-possible surfaces through markers: the solver that needs no simulated states."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ...core.arrays import Float, Int
from .attachment import Attachment
from .elastic_net import ElasticNet
from .local_step import fit_rotations
from .time_budget import TimeBudget

_STILL = 1e-5  # of the body's size: vertices that move less stand still
_MOST = 200  # rounds
_FREEDOM = 0.05  # of the body's size: how far it is thought to leave what is most rigid


class ArapSolver:
    """Warm-started rounds of a local and a global step. Markers are soft by their standard
    deviation, hard where it is zero, left out where it is infinite: the Laplacian's factor stays,
    and each frame solves for the markers' m forces (Woodbury's identity)."""

    def __init__(
        self, net: ElasticNet, attachment: Attachment, size: float,
        still: float = _STILL, most: int = _MOST,
    ) -> None:  # fmt: skip
        self._net, self._attachment = net, attachment
        self._still, self._most = still * size, most
        self._response = net.responses(attachment.matrix(len(net.rest)).toarray().T)
        response = self._response[attachment.corners]
        self._compliance = np.einsum("mk,mkp->mp", attachment.weights, response)
        # A force on a marker is (y - x) / (softness sd^2).
        self._softness = float(np.median(np.diag(self._compliance))) / (_FREEDOM * size) ** 2
        self._forces = lru_cache(4)(self._factor)
        self.rounds = 0
        self.reset()

    def reset(self) -> None:
        """Begin at rest."""
        self._x, self._rotations = self._net.rest.copy(), self._net.no_rotations()

    @property
    def name(self) -> str:
        """In words."""
        return "as rigid as possible"

    def solve(self, markers: Float, sd: Float, budget: TimeBudget) -> tuple[Float, Float]:
        """Vertices (n, 3) mm and their rotations (n, 9) of markers (m, 3) mm with standard
        deviations (m,) mm; the place of those that are not seen (infinite) is of no matter."""
        net, attachment = self._net, self._attachment
        seen = np.isfinite(sd)
        factor = self._forces(sd.tobytes())
        self.rounds = 0
        while self.rounds < self._most and budget.allows():
            right = np.zeros((3, len(net.rest)))
            fit_rotations(
                net.ptr, net.ends, net.weights, net.edges, self._x, self._rotations, right
            )
            x = net.integrate(right, self._x)
            off = markers - attachment.stand_off(self._rotations) - attachment.on_surface(x)
            off[~seen] = 0.0
            x += self._response @ lu_solve(factor, off, check_finite=False)
            moved = float(np.abs(x - self._x).max())
            self._x = x
            self.rounds += 1
            if moved < self._still:
                break
        return self._x, self._rotations

    def _factor(self, sd: bytes) -> tuple[Float, Int]:
        variance = self._softness * np.frombuffer(sd) ** 2
        seen = np.isfinite(variance)
        system = np.where(seen[:, None] & seen, self._compliance, 0.0)
        factor, pivots = lu_factor(system + np.diag(np.where(seen, variance, 1.0)))
        return factor, pivots
