"""As-rigid-as-possible surfaces through markers: the solver that needs no simulated states."""

from __future__ import annotations

import time
from collections import OrderedDict
from functools import lru_cache

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ...core.arrays import Bool, Float, Int
from .deformation_modes import MarkerMap, RotationStrain
from .discrepancy import Discrepancy, NoisyMarkers
from .elastic_net import ElasticNet, fit_rotations
from .rotation import rigid_fit
from .surface_mesh import Attachment

# The surface from the modes of simulated states, and beyond them as far as the markers ask.
#
# A frame takes three steps: the modes' coordinates, and how far the body may differ from them, from
# the markers with their noise; the surface of the modes, on which what the markers say beyond is
# spread smoothly; then each vertex' rotation is fitted anew to that surface as rigidly as possible,
# with its edges as strained as the modes say, and the surface integrated again. The last step is
# repeated where the body is far from all modes.

_FITS = 4  # steps of Gauss and Newton for the coordinates
_SETTLED = 1e-3  # standard deviations of a coordinate
_FURTHEST = 1.2  # of the range of the polynomials, which say nothing beyond
_FAR = 0.01  # of the body's size: further from the modes, rotations are fitted more than once
_MOST_MODE_SOLVER = 4  # fits of rotations: more take up the markers' noise
_CERTAIN = 1e-4  # of the body's size: no marker is better known than that
_KEPT = 4  # sets of uncertainties whose decomposition is kept


class ModeSolver:
    """Of simulated states as vertices (s, n, 3) mm in the net's order. `beyond`: whether the
    surface may leave the modes."""

    def __init__(
        self, net: ElasticNet, states: Float, attachment: Attachment, size: float,
        beyond: bool = True,
    ) -> None:  # fmt: skip
        self._net, self._attachment, self._size, self._beyond = net, attachment, size, beyond
        self._modes = RotationStrain.of(net, states)
        self._map = MarkerMap.of(self._modes, attachment)
        self._discrepancy = Discrepancy.of(net, attachment, size)
        self._noises: OrderedDict[bytes, NoisyMarkers] = OrderedDict()
        self._floating = not net.fixed.any()
        self.rounds = 0
        self.tau = 0.0
        self.reset()

    def reset(self) -> None:
        """Begin at rest."""
        self._q = np.zeros(self._modes.modes)
        self._turn, self._shift = np.eye(3), np.zeros(3)
        self._bias = np.zeros(self._attachment.offset.shape)

    @property
    def name(self) -> str:
        """In words."""
        beyond = ", and beyond them as rigid as possible" if self._beyond else ""
        return f"{self._modes.modes} modes of the simulated states{beyond}"

    def solve(self, markers: Float, sd: Float, budget: TimeBudget) -> tuple[Float, Float]:
        """Vertices (n, 3) mm and their rotations (n, 9) of markers (m, 3) mm with standard
        deviations (m,) mm; the place of those that are not seen (infinite) is of no matter."""
        net = self._net
        noise = self._noise(sd)
        markers = np.where(noise.precision[:, None] > 0, markers, 0.0)
        while budget.allows():
            shrinkage = self._fit(markers, noise)
            x, rotations, edges = self._modes.surface(self._q, net.rest)
            if self._settled(x, rotations):
                break
        turn, shift = self._turn, self._shift
        own = (markers - shift) @ turn  # in the frame of the body at rest
        self.rounds = 0
        if self._beyond:
            x = self._corrected(x, rotations, own, noise, shrinkage)
            far = self.tau > _FAR * self._size
            while self.rounds < (_MOST_MODE_SOLVER if far else 1) and budget.allows():
                right = np.zeros((3, len(x)))
                fit_rotations(net.ptr, net.ends, net.weights, edges, x, rotations, right)
                x = net.integrate(right, net.rest)
                x = self._corrected(x, rotations, own, noise, shrinkage)
                self.rounds += 1
        if self._floating:
            x = x @ turn.T + shift
            rotations = np.einsum("ij,njk->nik", turn, rotations.reshape(-1, 3, 3)).reshape(-1, 9)
        return x, rotations

    def _fit(self, markers: Float, noise: NoisyMarkers) -> Float:
        """Find the coordinates, and where the body is as a whole if nothing is fixed; returns the
        shrinkage (m,) of its difference from the modes."""
        for _ in range(_FITS):
            at, slopes = self._map.at(self._q)
            at = at + self._bias
            if self._floating and np.count_nonzero(noise.precision) > 2:
                self._turn, self._shift = rigid_fit(at, markers, noise.precision**2)
            off = (markers - self._shift) @ self._turn - at
            q, shrinkage, self.tau = noise.fit(off, slopes, self._q)
            q = np.clip(q, -_FURTHEST * self._map.limits, _FURTHEST * self._map.limits)
            moved = float(np.abs(q - self._q).max())
            self._q = q
            if moved < _SETTLED:
                break
        return shrinkage

    def _settled(self, x: Float, rotations: Float) -> bool:
        """Whether markers on the surface of the modes are where the fit took them to be. What its
        polynomials are off by is put right in the next fit, which may be that of the next frame."""
        attachment = self._attachment
        at = attachment.on_surface(x) + attachment.stand_off(rotations)
        bias = at - self._map.at(self._q)[0]
        change = float(np.abs(bias - self._bias).max())
        self._bias = bias
        return change < _CERTAIN * self._size

    def _corrected(
        self, x: Float, rotations: Float, markers: Float, noise: NoisyMarkers, shrinkage: Float
    ) -> Float:
        attachment = self._attachment
        off = markers - attachment.stand_off(rotations) - attachment.on_surface(x)
        return np.asarray(x + self._discrepancy.field @ noise.loads(off, shrinkage))

    def _noise(self, sd: Float) -> NoisyMarkers:
        key = sd.tobytes()
        found = self._noises.pop(key, None)
        if found is None:
            found = self._discrepancy.beside(1.0 / np.maximum(sd, _CERTAIN * self._size))
        self._noises[key] = found
        if len(self._noises) > _KEPT:
            self._noises.popitem(last=False)
        return found


# How long a frame may take.


class TimeBudget:
    """Of `seconds` from now on, None for as long as it takes: `allows` one more round while one as
    long as the longest so far still ends in time. The first round is always allowed."""

    def __init__(self, seconds: float | None) -> None:
        self._last = time.perf_counter()
        self._end = None if seconds is None else self._last + seconds
        self._longest = 0.0
        self._rounds = 0

    def allows(self) -> bool:
        """To be asked before each round."""
        now = time.perf_counter()
        if self._rounds:
            self._longest = max(self._longest, now - self._last)
        self._last = now
        self._rounds += 1
        if self._end is None or self._rounds == 1:
            return True
        return now + self._longest <= self._end


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
