"""How far a device is in each of its poses: least squares of its markers on the poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import ControlError
from .least_squares import fit

# How a device's markers move in each of its poses, from rest to the full pose and beyond.

_OPPOSITE = -0.5  # cosine between two poses' first movements below which one undoes the other


@dataclass(frozen=True)
class PoseRamp:
    """One pose at several amplitudes (k,), which rise, 1 being the full pose: displacements
    (k, m, 3) mm of the markers from rest. Rest itself may be left out."""

    amplitudes: Float
    displacements: Float

    def __post_init__(self) -> None:
        a, u = self.amplitudes, self.displacements
        if a.ndim != 1 or u.ndim != 3 or u.shape[::2] != (len(a), 3) or not len(a):
            raise ControlError(
                "a pose needs displacements (k, m, 3) at k amplitudes, not of shapes"
                f" {a.shape} and {u.shape}",
                code="shape-mismatch",
            )
        if not (np.isfinite(a).all() and np.isfinite(u).all()):
            raise ControlError(
                "a pose's amplitudes and displacements must be finite", code="not-finite"
            )
        if a[0] < 0 or (np.diff(a) <= 0).any() or a[-1] <= 0:
            raise ControlError(
                "a pose's amplitudes must be positive and strictly increasing",
                code="not-increasing",
            )
        if a[0] == 0 and u[0].any():
            raise ControlError(
                "at amplitude 0 a pose must not move its markers", code="rest-displaced"
            )


@dataclass(frozen=True)
class PoseBasis:
    """Poses by their names. Between its amplitudes a pose runs along parabolas that meet smoothly
    (cubic Hermite, slopes of the parabola through three neighbours), beyond its last one straight
    on.

    Packed for compiled functions: `knots` (p, k), of which the first `counts` (p,) of each pose are
    used, `values` and `slopes` (p, k, m, 3). `opposites` (p, p) are the pairs of which one undoes
    the other, such as bending up and down."""

    names: tuple[str, ...]
    ramps: tuple[PoseRamp, ...]
    knots: Float = field(init=False, repr=False)
    counts: Int = field(init=False, repr=False)
    values: Float = field(init=False, repr=False)
    slopes: Float = field(init=False, repr=False)
    opposites: Bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) != len(self.names):
            raise ControlError("poses need different names, at least one", code="names-not-unique")
        if len(self.names) != len(self.ramps):
            raise ControlError(
                f"{len(self.names)} names for {len(self.ramps)} poses", code="counts-differ"
            )
        markers = {ramp.displacements.shape[1] for ramp in self.ramps}
        if len(markers) != 1 or not max(markers):
            raise ControlError(
                "all poses must move the same markers, at least one", code="markers-differ"
            )
        begun = [_from_rest(ramp) for ramp in self.ramps]
        counts = np.array([len(a) for a, _ in begun])
        shape = (len(begun), int(counts.max()))
        knots = np.zeros(shape)
        values, slopes = np.zeros((2, *shape, *begun[0][1].shape[1:]))
        for p, (a, u) in enumerate(begun):
            knots[p, : len(a)], values[p, : len(a)] = a, u
            slopes[p, : len(a)] = _slopes(a, u)
        for name, value in (
            ("knots", knots),
            ("counts", counts),
            ("values", values),
            ("slopes", slopes),
            ("opposites", _opposites(slopes[:, 0])),
        ):
            object.__setattr__(self, name, value)

    def displacements(self, amplitudes: Sequence[float] | Float) -> Float:
        """(m, 3) mm: the poses' displacements at these amplitudes (p,), added up."""
        from .least_squares import add_poses

        jacobian = np.empty((len(self.names), *self.values.shape[2:]))
        total = np.zeros(self.values.shape[2:])
        a = np.asarray(amplitudes, float)
        add_poses(a, self.knots, self.counts, self.values, self.slopes, total, jacobian)
        return total


def _from_rest(ramp: PoseRamp) -> tuple[Float, Float]:
    a, u = ramp.amplitudes, ramp.displacements
    if a[0] == 0:
        return a, u
    return np.insert(a, 0, 0.0), np.concatenate([np.zeros_like(u[:1]), u])


def _slopes(a: Float, u: Float) -> Float:
    """(k, m, 3) mm per amplitude, at each of k."""
    step = np.diff(a)[:, None, None]
    chord = np.diff(u, axis=0) / step
    if len(chord) == 1:
        return np.concatenate([chord, chord])
    inner = (step[1:] * chord[:-1] + step[:-1] * chord[1:]) / (step[:-1] + step[1:])
    first, last = 2 * chord[0] - inner[0], 2 * chord[-1] - inner[-1]
    return np.concatenate([first[None], inner, last[None]])


def _opposites(first: Float) -> Bool:
    """(p, p) of the poses' movements (p, m, 3) as they begin."""
    flat = first.reshape(len(first), -1)
    size = np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    cosine = (flat / size) @ (flat / size).T
    return np.asarray(cosine < _OPPOSITE)


#: Half-axis of the ball that holds 90 % of a normal error in three coordinates, in its standard
#: deviations: the root of the 90 % quantile of chi^2 with three degrees of freedom, 6.251.
RADIUS_90 = 2.5003

_MOST = 1.5  # greatest amplitude; poses beyond their last known state are a guess
_PRIOR = 1.0  # 1 over the variance of amplitudes that is assumed: it decides what nothing else does
_FINEST = 0.05  # mm: no marker is known better
_HALF_CERTAIN = 0.1  # standard deviation of an amplitude that halves its confidence


@dataclass(frozen=True)
class Amplitudes:
    """`values` (p,) >= 0, 1 being the full pose, their standard deviation `sd` (p,), and the
    `confidence` (p,) 0..1: the share `explained` of the motion that the poses account for, times
    how certain each amplitude is."""

    values: Float
    sd: Float
    confidence: Float
    explained: float


class PoseAmplitudes:
    """Finds amplitudes sample after sample, each from the last.

    Minimised is the sum over markers of |u - sum of the poses' displacements|^2 / sd^2, with
    amplitudes of at least 0 and a weak prior towards rest; poses that undo each other are never
    both active. `independent` is how many numbers the markers really were made of: those decoded
    from three cords err together, and forty of them are no more certain than three. None: every
    coordinate errs on its own, as with cameras.
    """

    def __init__(self, basis: PoseBasis, independent: int | None = None) -> None:
        self.basis = basis
        markers = basis.values.shape[2]
        self._independent = independent or 3 * markers
        self._last = np.zeros(len(basis.names))
        # Compiled before the first sample comes, which takes seconds where nothing is kept.
        self(np.zeros((markers, 3)), np.ones(markers))

    def __call__(self, displacement: Float, sd: Float) -> Amplitudes:
        """Amplitudes of displacements (m, 3) mm from rest, each coordinate with the standard
        deviation sd (m,) mm. A marker counts for nothing where either is no number."""
        u = np.ascontiguousarray(displacement, float)
        if u.shape != self.basis.values.shape[2:] or sd.shape != u.shape[:1]:
            raise ControlError(
                f"displacements have shape {u.shape} and sd {sd.shape}; the poses have"
                f" {self.basis.values.shape[2]} markers",
                code="shape-mismatch",
                markers=self.basis.values.shape[2],
            )
        seen = np.isfinite(u).all(axis=1) & np.isfinite(sd)
        count = 3 * int(seen.sum())
        if count == 0:
            zero = np.zeros(len(self._last))
            return Amplitudes(self._last.copy(), zero + np.inf, zero, 0.0)
        weights = np.where(seen, 1 / np.maximum(np.where(seen, sd, 1.0), _FINEST) ** 2, 0.0)
        u = np.where(seen[:, None], u, 0.0)
        independent = min(self._independent, count)
        # Two standard deviations of chi^2 above what is expected of noise alone.
        expected = count * (1 + 2 * np.sqrt(2 / independent))
        a, b = self._last.copy(), self.basis
        left, H = fit(
            a, _MOST, u, weights, _PRIOR, b.opposites, expected,
            b.knots, b.counts, b.values, b.slopes,
        )  # fmt: skip
        self._last = a
        unexplained = max(0.0, left - expected)
        moved = float(weights @ (u**2).sum(axis=1))
        explained = float(1 - unexplained / (max(moved, unexplained) + count))
        spread = np.sqrt(max(1.0, left / count) * count / independent)
        deviation = spread * _deviation(H, (a > 0) & (a < _MOST))
        certain = 1 / (1 + (deviation / _HALF_CERTAIN) ** 2)
        return Amplitudes(a.copy(), deviation, explained * certain, explained)


def _deviation(H: Float, free: Bool) -> Float:
    """(p,): of the free ones together; of one at its bound as if the others were known."""
    out: Float = 1 / np.sqrt(np.diag(H))
    if free.any():
        out[free] = np.sqrt(np.diag(np.linalg.inv(H[np.ix_(free, free)])))
    return out
