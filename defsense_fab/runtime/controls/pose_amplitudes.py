"""Find how far a device is in each of its poses, by least squares of its marker positions.

A `PoseBasis` holds the marker displacements of the poses; `PoseAmplitudes` fits their amplitudes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import ControlError
from .least_squares import add_poses, fit

#: Half-axis of the ball that holds 90 % of a normal error in three coordinates, in its standard
#: deviations: the root of the 90 % quantile of chi^2 with three degrees of freedom, 6.251.
RADIUS_90 = 2.5003

_OPPOSITE_COSINE = -0.5  # of the first movements of two poses; below it one undoes the other
_MAX_AMPLITUDE = 1.5  # poses are extrapolated beyond their last simulated state
_PRIOR = 1.0  # inverse variance of amplitudes; it decides only what the markers leave open
_MIN_MARKER_SD_MM = 0.05  # no marker is known better
_HALF_CONFIDENCE_SD = 0.1  # standard deviation of an amplitude that halves its confidence


@dataclass(frozen=True)
class PoseRamp:
    """The marker displacements of one pose at several amplitudes.

    Attributes:
        amplitudes: Amplitudes (k,), increasing, 1 being the full pose; 0 may be left out.
        displacements: Displacements (k, m, 3) of the markers from rest, mm.

    Raises:
        ControlError: The arrays have wrong shapes or values.
    """

    amplitudes: Float
    displacements: Float

    def __post_init__(self) -> None:
        a, u = self.amplitudes, self.displacements
        if a.ndim != 1 or u.ndim != 3 or u.shape[::2] != (len(a), 3) or not len(a):
            raise ControlError(
                f"amplitudes have shape {a.shape} and displacements {u.shape}, expected (k,) and"
                " (k, m, 3)",
                code="wrong-shape",
            )
        if not (np.isfinite(a).all() and np.isfinite(u).all()):
            raise ControlError(
                "the amplitudes and displacements of a pose must be finite", code="not-finite"
            )
        if a[0] < 0 or (np.diff(a) <= 0).any() or a[-1] <= 0:
            raise ControlError(
                "the amplitudes of a pose must start at 0 or above and increase",
                code="not-increasing",
            )
        if a[0] == 0 and u[0].any():
            raise ControlError(
                "the displacements of a pose at amplitude 0 must be 0", code="rest-displaced"
            )


@dataclass(frozen=True)
class PoseBasis:
    """The poses of a device, as functions of their amplitudes.

    Between its states a pose follows cubic Hermite curves whose slopes are those of the parabola
    through three neighboring states. Beyond its last state it continues linearly.

    Attributes:
        names: Names of the p poses.
        ramps: Displacements of each pose.

    Raises:
        ControlError: The names are not unique, or the ramps do not fit each other.
    """

    names: tuple[str, ...]
    ramps: tuple[PoseRamp, ...]

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) != len(self.names):
            raise ControlError(
                "poses need at least one name, and different names", code="name-repeated"
            )
        if len(self.names) != len(self.ramps):
            raise ControlError(
                f"there are {len(self.names)} names for {len(self.ramps)} poses",
                code="count-differs",
            )
        markers = {ramp.displacements.shape[1] for ramp in self.ramps}
        if len(markers) != 1 or not max(markers):
            raise ControlError(
                "all poses must have the same markers, at least one", code="markers-differ"
            )

    @property
    def markers(self) -> int:
        """Number of markers m."""
        return len(self.ramps[0].displacements[0])

    @cached_property
    def packed(self) -> tuple[Float, Int, Float, Float]:
        """The ramps as arrays for compiled functions; see `least_squares`."""
        ramps = [_with_rest(ramp) for ramp in self.ramps]
        counts = np.array([len(a) for a, _ in ramps])
        shape = (len(ramps), int(counts.max()))
        knots = np.zeros(shape)
        values, slopes = np.zeros((2, *shape, self.markers, 3))
        for p, (a, u) in enumerate(ramps):
            knots[p, : len(a)], values[p, : len(a)] = a, u
            slopes[p, : len(a)] = _slopes(a, u)
        return knots, counts, values, slopes

    @cached_property
    def opposites(self) -> Bool:
        """Pairs of poses (p, p) of which one undoes the other, such as bending up and down."""
        return _opposites(self.packed[3][:, 0])

    def displacements(self, amplitudes: Sequence[float] | Float) -> Float:
        """Return the sum of the poses' displacements (m, 3), mm, at amplitudes (p,)."""
        total = np.zeros((self.markers, 3))
        jacobian = np.empty((len(self.names), *total.shape))
        add_poses(np.asarray(amplitudes, float), self.packed, total, jacobian)
        return total


def _with_rest(ramp: PoseRamp) -> tuple[Float, Float]:
    """Return amplitudes and displacements that start at rest."""
    a, u = ramp.amplitudes, ramp.displacements
    if a[0] == 0:
        return a, u
    return np.insert(a, 0, 0.0), np.concatenate([np.zeros_like(u[:1]), u])


def _slopes(a: Float, u: Float) -> Float:
    """Return the derivatives (k, m, 3) of displacements at amplitudes (k,), mm per amplitude."""
    step = np.diff(a)[:, None, None]
    chord = np.diff(u, axis=0) / step
    if len(chord) == 1:
        return np.concatenate([chord, chord])
    inner = (step[1:] * chord[:-1] + step[:-1] * chord[1:]) / (step[:-1] + step[1:])
    first, last = 2 * chord[0] - inner[0], 2 * chord[-1] - inner[-1]
    return np.concatenate([first[None], inner, last[None]])


def _opposites(first: Float) -> Bool:
    """Return the pairs (p, p) whose first movements (p, m, 3) point in opposite directions."""
    flat = first.reshape(len(first), -1)
    size = np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    cosine = (flat / size) @ (flat / size).T
    return np.asarray(cosine < _OPPOSITE_COSINE)


@dataclass(frozen=True)
class Amplitudes:
    """The fitted amplitudes of p poses.

    Attributes:
        values: Amplitudes (p,), at least 0, 1 being the full pose.
        sd: Their standard deviations (p,).
        confidence: Confidences (p,), 0..1: `explained` times the certainty of each amplitude.
        explained: Share of the motion that the poses account for.
    """

    values: Float
    sd: Float
    confidence: Float
    explained: float


class PoseAmplitudes:
    """Fit amplitudes frame after frame, each starting from the last.

    The fit minimizes the sum over markers of |u - sum of the poses' displacements|^2 / sd^2, with
    amplitudes of at least 0 and a weak prior towards rest. Poses that undo each other are never
    both active.

    Args:
        basis: The poses.
        independent: Number of independent measurements behind the markers. The errors of markers
            that were decoded from three cords are correlated: forty of them are no more certain
            than three. By default all coordinates are independent, as with cameras.
    """

    def __init__(self, basis: PoseBasis, independent: int | None = None) -> None:
        self.basis = basis
        markers = basis.markers
        self._independent = independent or 3 * markers
        self._last = np.zeros(len(basis.names))
        # Compile before the first frame, which takes seconds without a cache.
        self(np.zeros((markers, 3)), np.ones(markers))

    def __call__(self, displacement: Float, sd: Float) -> Amplitudes:
        """Return the amplitudes of a frame.

        Args:
            displacement: Displacements of the markers from rest (m, 3), mm.
            sd: Standard deviation of each coordinate of the markers (m,), mm. Markers without a
                finite displacement and deviation are left out.

        Raises:
            ControlError: The shapes do not fit the markers of the poses.
        """
        u = np.ascontiguousarray(displacement, float)
        markers = self.basis.markers
        if u.shape != (markers, 3) or sd.shape != u.shape[:1]:
            raise ControlError(
                f"displacements have shape {u.shape} and sd {sd.shape}; the poses have"
                f" {markers} markers",
                code="wrong-shape",
                markers=markers,
            )
        visible = np.isfinite(u).all(axis=1) & np.isfinite(sd)
        count = 3 * int(visible.sum())
        if count == 0:
            zero = np.zeros(len(self._last))
            return Amplitudes(self._last.copy(), zero + np.inf, zero, 0.0)
        safe_sd = np.maximum(np.where(visible, sd, 1.0), _MIN_MARKER_SD_MM)
        weights = np.where(visible, 1 / safe_sd**2, 0.0)
        u = np.where(visible[:, None], u, 0.0)
        independent = min(self._independent, count)
        # Two standard deviations of chi^2 above the sum that is expected of noise alone.
        expected = count * (1 + 2 * np.sqrt(2 / independent))
        a, basis, measured = self._last.copy(), self.basis, (u, weights, _PRIOR)
        residual, H = fit(a, _MAX_AMPLITUDE, basis.packed, measured, basis.opposites, expected)
        self._last = a
        unexplained = max(0.0, residual - expected)
        moved = float(weights @ (u**2).sum(axis=1))
        explained = float(1 - unexplained / (max(moved, unexplained) + count))
        spread = np.sqrt(max(1.0, residual / count) * count / independent)
        deviation = spread * _deviation(H, (a > 0) & (a < _MAX_AMPLITUDE))
        certainty = 1 / (1 + (deviation / _HALF_CONFIDENCE_SD) ** 2)
        return Amplitudes(a.copy(), deviation, explained * certainty, explained)


def _deviation(H: Float, free: Bool) -> Float:
    """Return standard deviations (p,): jointly of free amplitudes, conditional of bounded ones."""
    deviation: Float = 1 / np.sqrt(np.diag(H))
    if free.any():
        deviation[free] = np.sqrt(np.diag(np.linalg.inv(H[np.ix_(free, free)])))
    return deviation
