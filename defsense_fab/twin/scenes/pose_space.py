"""Interpolation of a device's simulated states over the levels of its poses.

The interpolant through s states is the cubic polyharmonic spline with a polynomial,
sum_k c_k |z - z_k|^3 + p(z), which has the least bending energy. It is linear in the values of the
states: one set of weights per frame serves markers, cords and the skin. Rest is one of the states,
with all values zero.

References:
    J. Duchon: Splines minimizing rotation-invariant semi-norms in Sobolev spaces. 1977.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import qr

from ...core.arrays import Float, Int
from ...core.errors import CaptureError

BLOCK_FRAMES = 4096  # frames evaluated at once
RANK_RTOL = 1e-8  # relative to the largest column: below, a polynomial term adds nothing
FOLDS = 10


@dataclass(frozen=True)
class PoseSpace:
    """An interpolant of state values over pose weights.

    Attributes:
        axes: Directions (r, d): coordinates are z = axes @ w for weights w of d poses. Poses that
            are opposite to each other share one axis.
        states: Pose weights (s, d) of the simulated states, without rest.

    Raises:
        CaptureError: There are too few states for the number of axes (`too-few-states`).
    """

    axes: Float
    states: Float

    def __post_init__(self) -> None:
        if len(self.states) < self.axes.shape[0] + 1:
            raise CaptureError(
                f"{len(self.states)} solved states are too few for {self.axes.shape[0]} independent"
                " poses",
                code="too-few-states",
                where="twin",
                action="Simulate more combinations of poses",
                states=len(self.states),
                axes=self.axes.shape[0],
            )

    def __call__(self, levels: Float) -> Float:
        """Return the weights (t, s) of the states' displacements at pose weights (t, d)."""
        z = levels @ self.axes.T
        weights = np.empty((len(z), len(self.states)))
        for k in range(0, len(z), BLOCK_FRAMES):
            weights[k : k + BLOCK_FRAMES] = self._terms(z[k : k + BLOCK_FRAMES]) @ self._cardinal
        return weights

    def predict_left_out(self, values: Float, groups: Int) -> tuple[Float, Int]:
        """Compute the error of interpolating each state from the others (cross-validation).

        States of one group are left out together, a tenth of the groups at a time.

        Args:
            values: Values of the states (s, ...).
            groups: Group number of each state (s,); states of group -1 are never left out, such as
                states beyond the range of the others.

        Returns:
            Predicted minus true values (k, ...) of the states that were left out, and their
            indices (k,).
        """
        numbers = np.random.default_rng(0).permutation(np.unique(groups[groups >= 0]))
        chosen = np.flatnonzero(groups >= 0)
        flat = values.reshape(len(values), -1)
        errors = np.zeros((len(chosen), flat.shape[1]))
        for fold in range(min(FOLDS, len(numbers))):
            is_left_out = np.isin(groups, numbers[fold::FOLDS])
            others = PoseSpace(self.axes, self.states[~is_left_out])
            predicted = others(self.states[is_left_out]) @ flat[~is_left_out]
            errors[is_left_out[chosen]] = predicted - flat[is_left_out]
        return errors.reshape(len(chosen), *values.shape[1:]), chosen

    @cached_property
    def _knots(self) -> Float:
        """Coordinates (s + 1, r) of rest and the states."""
        return np.asarray(np.pad(self.states @ self.axes.T, ((1, 0), (0, 0))))

    @cached_property
    def _powers(self) -> Float:
        """Exponents (q, r) of the polynomial terms.

        Terms of second degree are used if there are enough states. Terms that the states cannot
        distinguish from the others are dropped.
        """
        r = self.axes.shape[0]
        unit = np.eye(r, dtype=int)
        terms = [np.zeros(r, int), *unit]
        second_degree = [unit[i] + unit[j] for i in range(r) for j in range(i, r)]
        if len(self._knots) >= 2 * (len(terms) + len(second_degree)):
            terms += second_degree
        powers = np.array(terms)
        _, upper, order = qr(_monomials(self._knots, powers), mode="economic", pivoting=True)
        size = np.abs(np.diag(upper))
        independent = np.sort(order[: len(size)][size > RANK_RTOL * size[0]])
        return np.asarray(powers[independent])

    @cached_property
    def _cardinal(self) -> Float:
        """Coefficients (s + 1 + q, s) of the functions that are 1 at one state and 0 at others."""
        knots, q = self._knots, len(self._powers)
        terms = self._terms(knots)
        system = np.zeros((len(knots) + q, len(knots) + q))
        system[: len(knots)] = terms
        system[len(knots) :, : len(knots)] = terms[:, len(knots) :].T
        target = np.zeros((len(system), len(self.states)))
        target[1 : len(knots)] = np.eye(len(self.states))
        return np.asarray(np.linalg.solve(system, target))

    def _terms(self, z: Float) -> Float:
        """Evaluate the radial and polynomial terms (t, s + 1 + q) at coordinates (t, r)."""
        square = ((z[:, None] - self._knots) ** 2).sum(2)
        return np.concatenate([square * np.sqrt(square), _monomials(z, self._powers)], axis=1)


def _monomials(z: Float, powers: Float) -> Float:
    return np.asarray(np.prod(z[:, None] ** powers, axis=2))
