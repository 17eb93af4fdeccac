"""How far a device is in each of its poses: least squares of its markers on the poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import ControlError
from .least_squares import fit
from .pose_basis import PoseBasis

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
