"""Solvers of the surface from markers: by modes of simulated states, or as rigid as possible."""

from __future__ import annotations

import time
from collections import OrderedDict
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ...core.arrays import Bool, Float, Int
from .deformation_modes import MarkerMap, RotationStrain
from .discrepancy import Discrepancy, NoisyMarkers
from .elastic_net import ElasticNet, fit_rotations
from .rotation import rigid_fit
from .surface_mesh import Attachment

# Sizes and distances are in units of the body's size.
_MAX_COORDINATE_STEPS = 4  # Gauss-Newton steps for the coordinates of the modes
_COORDINATE_TOLERANCE = 1e-3  # standard deviations
_MAX_COORDINATE = 1.2  # of the range of the polynomials, which are invalid beyond it
_MAX_TAU_SINGLE_FIT = 0.01  # farther from the modes, rotations are fitted more than once
_MAX_ROTATION_FITS = 4  # more would follow the markers' noise
_MIN_MARKER_SD = 1e-4  # no marker is known better
_MAX_NOISE_CACHE = 4  # sets of uncertainties

_CONVERGED_MOVE = 1e-5  # of a vertex in one iteration
_MAX_ITERATIONS = 200
_FREEDOM = 0.05  # expected distance of the body from the most rigid shape
_MIN_COMPLIANCE = 1e-10  # of a typical one; for markers on fixed vertices, or two in one place
_MIN_SMOOTH_SD = 1e-2  # of _FREEDOM: accuracy of the smooth move


class TimeBudget:
    """Time for a frame.

    Args:
        seconds: The time from now on, s; None for no limit.
    """

    def __init__(self, seconds: float | None) -> None:
        self._last = time.perf_counter()
        self._end = None if seconds is None else self._last + seconds
        self._longest = 0.0
        self._iterations = 0

    def allows(self) -> bool:
        """Return, before each iteration, whether another one as long as the longest still fits.

        The first iteration is always allowed.
        """
        now = time.perf_counter()
        if self._iterations:
            self._longest = max(self._longest, now - self._last)
        self._last = now
        self._iterations += 1
        if self._end is None or self._iterations == 1:
            return True
        return now + self._longest <= self._end


class Solver(Protocol):
    """A solver of the surface, warm-started from frame to frame.

    Attributes:
        rounds: Number of iterations of the last frame.
    """

    rounds: int

    @property
    def name(self) -> str: ...

    def reset(self) -> None: ...

    def solve(self, markers: Float, sd: Float, budget: TimeBudget) -> tuple[Float, Float]: ...


class ModeSolver:
    """Solve the surface from the modes of simulated states, and beyond them as markers require.

    A frame takes three steps. First the coordinates of the modes, and how far the body may differ
    from them, are fitted to the markers with their noise. Then what the markers show beyond the
    surface of the modes is spread smoothly over it. Last, each vertex' rotation is fitted to that
    surface as rigidly as possible, with its edges strained as in the modes, and the surface is
    integrated again. The last step is repeated if the body is far from all modes.

    Args:
        net: Half edges of the surface.
        states: Vertices in the simulated states (s, n, 3), mm, in the net's order.
        attachment: Where the markers sit.
        size: Size of the body, mm.
        beyond: Whether the surface may leave the modes.

    Attributes:
        rounds: Number of rotation fits of the last frame.
        tau: Fitted size of the difference from the modes, mm.
    """

    def __init__(
        self,
        net: ElasticNet,
        states: Float,
        attachment: Attachment,
        size: float,
        beyond: bool = True,
    ) -> None:
        self._net, self._attachment, self._size, self._beyond = net, attachment, size, beyond
        self._modes = RotationStrain.of(net, states)
        self._map = MarkerMap.of(self._modes, attachment)
        self._discrepancy = Discrepancy.of(net, attachment, size)
        self._noises: OrderedDict[bytes, NoisyMarkers] = OrderedDict()
        self._is_floating = not net.fixed.any()
        self.rounds = 0
        self.tau = 0.0
        self.reset()

    def reset(self) -> None:
        """Start from rest."""
        self._q = np.zeros(self._modes.modes)
        self._turn, self._shift = np.eye(3), np.zeros(3)
        self._bias = np.zeros(self._attachment.offset.shape)

    @property
    def name(self) -> str:
        """Description of the method."""
        beyond = ", and beyond them as rigid as possible" if self._beyond else ""
        return f"{self._modes.modes} modes of the simulated states{beyond}"

    def solve(self, markers: Float, sd: Float, budget: TimeBudget) -> tuple[Float, Float]:
        """Solve a frame.

        Args:
            markers: Marker positions (m, 3), mm; those of invisible markers are ignored.
            sd: Their standard deviations (m,), mm; infinite for invisible markers.
            budget: Time for the frame.

        Returns:
            Vertices (n, 3), mm, and their rotations (n, 9).
        """
        net = self._net
        noise = self._noise(sd)
        markers = np.where(noise.precision[:, None] > 0, markers, 0.0)
        while budget.allows():
            shrinkage = self._fit_coordinates(markers, noise)
            x, rotations, edges = self._modes.surface(self._q, net.rest)
            if self._update_bias(x, rotations):
                break
        turn, shift = self._turn, self._shift
        rest_markers = (markers - shift) @ turn  # in the frame of the body at rest
        self.rounds = 0
        if self._beyond:
            x = self._correct(x, rotations, rest_markers, noise, shrinkage)
            is_far = self.tau > _MAX_TAU_SINGLE_FIT * self._size
            while self.rounds < (_MAX_ROTATION_FITS if is_far else 1) and budget.allows():
                right = np.zeros((3, len(x)))
                fit_rotations(net.ptr, net.ends, net.weights, edges, x, rotations, right)
                x = net.integrate(right, net.rest)
                x = self._correct(x, rotations, rest_markers, noise, shrinkage)
                self.rounds += 1
        if self._is_floating:
            x = x @ turn.T + shift
            rotations = np.einsum("ij,njk->nik", turn, rotations.reshape(-1, 3, 3)).reshape(-1, 9)
        return x, rotations

    def _fit_coordinates(self, markers: Float, noise: NoisyMarkers) -> Float:
        """Fit the coordinates, and the rigid motion of a floating body.

        Returns:
            The shrinkage (m,) of the difference from the modes.
        """
        for _ in range(_MAX_COORDINATE_STEPS):
            at, slopes = self._map.evaluate(self._q)
            at = at + self._bias
            if self._is_floating and np.count_nonzero(noise.precision) > 2:
                self._turn, self._shift = rigid_fit(at, markers, noise.precision**2)
            off = (markers - self._shift) @ self._turn - at
            q, shrinkage, self.tau = noise.fit(off, slopes, self._q)
            q = np.clip(q, -_MAX_COORDINATE * self._map.limits, _MAX_COORDINATE * self._map.limits)
            change = float(np.abs(q - self._q).max())
            self._q = q
            if change < _COORDINATE_TOLERANCE:
                break
        return shrinkage

    def _update_bias(self, x: Float, rotations: Float) -> bool:
        """Measure the error of the polynomials; return whether it has converged.

        The error is corrected in the next fit, which may be that of the next frame.
        """
        attachment = self._attachment
        at = attachment.on_surface(x) + attachment.stand_off(rotations)
        bias = at - self._map.evaluate(self._q)[0]
        change = float(np.abs(bias - self._bias).max())
        self._bias = bias
        return change < _MIN_MARKER_SD * self._size

    def _correct(
        self, x: Float, rotations: Float, markers: Float, noise: NoisyMarkers, shrinkage: Float
    ) -> Float:
        attachment = self._attachment
        off = markers - attachment.stand_off(rotations) - attachment.on_surface(x)
        return np.asarray(x + self._discrepancy.field @ noise.loads(off, shrinkage))

    def _noise(self, sd: Float) -> NoisyMarkers:
        key = sd.tobytes()
        noise = self._noises.pop(key, None)
        if noise is None:
            noise = self._discrepancy.with_noise(1.0 / np.maximum(sd, _MIN_MARKER_SD * self._size))
        self._noises[key] = noise
        if len(self._noises) > _MAX_NOISE_CACHE:
            self._noises.popitem(last=False)
        return noise


class ArapSolver:
    """Solve the surface as rigid as possible, without simulated states.

    Iterations alternate a local and a global step. Markers are soft by their standard deviation,
    hard if it is zero, and left out if it is infinite: the factor of the Laplacian is kept, and
    each iteration solves for the forces of the m markers (Woodbury's identity). Iterations
    propagate distant changes slowly. So a frame starts with the last surface moved smoothly by the
    distances of the markers; the converged result does not depend on this.

    Args:
        net: Half edges of the surface.
        attachment: Where the markers sit.
        size: Size of the body, mm.
        tolerance: Move of a vertex in one iteration that counts as converged, of the size.
        max_rounds: Largest number of iterations per frame.

    Attributes:
        rounds: Number of iterations of the last frame.
        max_rounds: Largest number of iterations per frame.
    """

    def __init__(
        self,
        net: ElasticNet,
        attachment: Attachment,
        size: float,
        tolerance: float = _CONVERGED_MOVE,
        max_rounds: int = _MAX_ITERATIONS,
    ) -> None:
        self._net, self._attachment = net, attachment
        self._tolerance, self.max_rounds = tolerance * size, max_rounds
        self._smooth = Discrepancy.of(net, attachment, size)
        self._reach = _FREEDOM * size
        self._response = net.responses(attachment.matrix(len(net.rest)).toarray().T)
        response = self._response[attachment.corners]
        self._compliance = np.einsum("mk,mkp->mp", attachment.weights, response)
        # The force on a marker is (y - x) / (softness sd^2).
        compliance = self._compliance
        if not net.fixed.any():  # the compliance of the ground does not matter
            compliance = compliance - compliance.mean(axis=0)
            compliance = compliance - compliance.mean(axis=1, keepdims=True)
        typical = float(np.diag(compliance).mean())
        self._softness = typical / (_FREEDOM * size) ** 2
        self._min_compliance = _MIN_COMPLIANCE * typical
        self._prepared = lru_cache(4)(self._prepare)
        self.rounds = 0
        self.reset()

    def reset(self) -> None:
        """Start from rest."""
        self._x, self._rotations = self._net.rest.copy(), self._net.no_rotations()

    @property
    def name(self) -> str:
        """Description of the method."""
        return "as rigid as possible"

    def solve(self, markers: Float, sd: Float, budget: TimeBudget) -> tuple[Float, Float]:
        """Solve a frame; arguments and result are those of `ModeSolver.solve`."""
        net = self._net
        visible = np.isfinite(sd)
        factor, smoother = self._prepared(sd.tobytes())
        self._x = self._x + self._smooth.field @ (smoother @ self._off(markers, visible, self._x))
        self.rounds = 0
        while self.rounds < self.max_rounds and budget.allows():
            right = np.zeros((3, len(net.rest)))
            fit_rotations(
                net.ptr, net.ends, net.weights, net.edges, self._x, self._rotations, right
            )
            x = net.integrate(right, self._x)
            off = self._off(markers, visible, x)
            x += self._response @ lu_solve(factor, off, check_finite=False)
            change = float(np.abs(x - self._x).max())
            self._x = x
            self.rounds += 1
            if change < self._tolerance:
                break
        return self._x, self._rotations

    def _off(self, markers: Float, visible: Bool, x: Float) -> Float:
        at = self._attachment.on_surface(x) + self._attachment.stand_off(self._rotations)
        return np.where(visible[:, None], markers - at, 0.0)

    def _prepare(self, deviations: bytes) -> tuple[tuple[Float, Int], Float]:
        """Return the factor for the forces, and the loads (m, m) of the smooth move."""
        sd = np.frombuffer(deviations)
        variance = self._softness * sd**2 + self._min_compliance
        visible = np.isfinite(variance)
        system = np.where(visible[:, None] & visible, self._compliance, 0.0)
        factor, pivots = lu_factor(system + np.diag(np.where(visible, variance, 1.0)))
        noisy = self._smooth.with_noise(1.0 / np.maximum(sd, _MIN_SMOOTH_SD * self._reach))
        shrinkage = self._reach**2 / (1.0 + self._reach**2 * noisy.values)
        return (factor, pivots), noisy.loads(np.eye(len(sd)), shrinkage)
