"""As-rigid-as-possible surfaces through markers: the solver that needs no simulated states."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ...core.arrays import Bool, Float, Int
from .attachment import Attachment
from .discrepancy import Discrepancy
from .elastic_net import ElasticNet
from .local_step import fit_rotations
from .time_budget import TimeBudget

_STILL = 1e-5  # of the body's size: vertices that move less stand still
_MOST = 200  # rounds
_FREEDOM = 0.05  # of the body's size: how far it is thought to leave what is most rigid
_LEAST = (
    1e-10  # of a typical compliance: markers on fixed vertices, and two at one place, are no harm
)
_NEAR = 1e-2  # of that: as near as a smooth move has to come to markers


class ArapSolver:
    """Warm-started rounds of a local and a global step, at most `most` of them a frame. Markers are
    soft by their standard deviation, hard where it is zero, left out where it is infinite: the
    Laplacian's factor stays, and each frame solves for the markers' m forces (Woodbury's identity).
    The rounds pass on slowly what is far away. So a frame begins with the last one's surface moved
    smoothly by what its markers are off; where the rounds end does not depend on it."""

    def __init__(
        self, net: ElasticNet, attachment: Attachment, size: float,
        still: float = _STILL, most: int = _MOST,
    ) -> None:  # fmt: skip
        self._net, self._attachment = net, attachment
        self._still, self.most = still * size, most
        self._smooth = Discrepancy.of(net, attachment, size)
        self._reach = _FREEDOM * size
        self._response = net.responses(attachment.matrix(len(net.rest)).toarray().T)
        response = self._response[attachment.corners]
        self._compliance = np.einsum("mk,mkp->mp", attachment.weights, response)
        # A force on a marker is (y - x) / (softness sd^2).
        own = self._compliance
        if not net.fixed.any():  # what the ground gives way, as a whole, is of no matter
            own = own - own.mean(axis=0)
            own = own - own.mean(axis=1, keepdims=True)
        typical = float(np.diag(own).mean())
        self._softness = typical / (_FREEDOM * size) ** 2
        self._least = _LEAST * typical
        self._prepared = lru_cache(4)(self._prepare)
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
        net = self._net
        seen = np.isfinite(sd)
        factor, smoother = self._prepared(sd.tobytes())
        self._x = self._x + self._smooth.field @ (smoother @ self._off(markers, seen, self._x))
        self.rounds = 0
        while self.rounds < self.most and budget.allows():
            right = np.zeros((3, len(net.rest)))
            fit_rotations(
                net.ptr, net.ends, net.weights, net.edges, self._x, self._rotations, right
            )
            x = net.integrate(right, self._x)
            off = self._off(markers, seen, x)
            x += self._response @ lu_solve(factor, off, check_finite=False)
            moved = float(np.abs(x - self._x).max())
            self._x = x
            self.rounds += 1
            if moved < self._still:
                break
        return self._x, self._rotations

    def _off(self, markers: Float, seen: Bool, x: Float) -> Float:
        at = self._attachment.on_surface(x) + self._attachment.stand_off(self._rotations)
        return np.where(seen[:, None], markers - at, 0.0)

    def _prepare(self, deviations: bytes) -> tuple[tuple[Float, Int], Float]:
        """The factor for the forces, and the loads (m, m) of a smooth move by what markers are off,
        for these standard deviations (m,)."""
        sd = np.frombuffer(deviations)
        variance = self._softness * sd**2 + self._least
        seen = np.isfinite(variance)
        system = np.where(seen[:, None] & seen, self._compliance, 0.0)
        factor, pivots = lu_factor(system + np.diag(np.where(seen, variance, 1.0)))
        noisy = self._smooth.beside(1.0 / np.maximum(sd, _NEAR * self._reach))
        shrinkage = self._reach**2 / (1.0 + self._reach**2 * noisy.values)
        return (factor, pivots), noisy.loads(np.eye(len(sd)), shrinkage)
