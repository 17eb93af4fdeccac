"""A device's shapes between states that were solved, as a smooth function of how far each pose is
taken.

The interpolant through s states is the cubic polyharmonic spline with a polynomial (Duchon 1977):
sum_k c_k |z - z_k|^3 + p(z), which bends least. It is linear in the states' values, so that one set
of weights a moment serves markers, cords and skin alike. Rest is among the states, with all values
zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import qr

from ...core.arrays import Float, Int
from ...core.errors import CaptureError

_BLOCK = 4096  # moments at once
_NOTHING = 1e-8  # of a polynomial's largest column: one that adds nothing to the others
_FOLDS = 10


@dataclass(frozen=True)
class PoseSpace:
    """`axes` (r, d): coordinates z = axes @ w of d poses' weights w, in which poses that are each
    other's opposite lie on one line; `states` (s, d): weights of the states, without rest. Raises
    CaptureError where there are too few."""

    axes: Float
    states: Float

    def __post_init__(self) -> None:
        if len(self.states) < self.axes.shape[0] + 1:
            raise CaptureError(
                f"{len(self.states)} solved states are too few for {self.axes.shape[0]} independent"
                " poses",
                code="states-too-few",
                where="twin",
                action="Simulate more combinations of poses",
                states=len(self.states),
                axes=self.axes.shape[0],
            )

    def __call__(self, levels: Float) -> Float:
        """Weights (t, s) of the states' displacements at poses' weights `levels` (t, d)."""
        z = levels @ self.axes.T
        out = np.empty((len(z), len(self.states)))
        for k in range(0, len(z), _BLOCK):
            out[k : k + _BLOCK] = self._terms(z[k : k + _BLOCK]) @ self._cardinal
        return out

    def left_out(self, values: Float, groups: Int) -> tuple[Float, Int]:
        """What states' values (s, ...) are by the others, less what they are, and which states
        those are. States of one number of `groups` (s,) are left out together, a tenth of the
        groups at a time; those of -1, which the others do not reach, never."""
        numbers = np.random.default_rng(0).permutation(np.unique(groups[groups >= 0]))
        chosen = np.flatnonzero(groups >= 0)
        flat = values.reshape(len(values), -1)
        off = np.zeros((len(chosen), flat.shape[1]))
        for fold in range(min(_FOLDS, len(numbers))):
            gone = np.isin(groups, numbers[fold::_FOLDS])
            less = PoseSpace(self.axes, self.states[~gone])
            off[gone[chosen]] = less(self.states[gone]) @ flat[~gone] - flat[gone]
        return off.reshape(len(chosen), *values.shape[1:]), chosen

    @cached_property
    def _knots(self) -> Float:
        """Coordinates (s + 1, r) of rest and the states."""
        return np.asarray(np.pad(self.states @ self.axes.T, ((1, 0), (0, 0))))

    @cached_property
    def _powers(self) -> Float:
        """Exponents (q, r) of the polynomial's terms: of second degree where there are states
        enough, and of those only what the states tell apart."""
        r = self.axes.shape[0]
        unit = np.eye(r, dtype=int)
        out = [np.zeros(r, int), *unit]
        second = [unit[i] + unit[j] for i in range(r) for j in range(i, r)]
        if len(self._knots) >= 2 * (len(out) + len(second)):
            out += second
        powers = np.array(out)
        _, upper, order = qr(_monomials(self._knots, powers), mode="economic", pivoting=True)
        size = np.abs(np.diag(upper))
        kept = np.sort(order[: len(size)][size > _NOTHING * size[0]])
        return np.asarray(powers[kept])

    @cached_property
    def _cardinal(self) -> Float:
        """(s + 1 + q, s): coefficients of the function that is 1 at a state and 0 at the others."""
        knots, q = self._knots, len(self._powers)
        terms = self._terms(knots)
        system = np.zeros((len(knots) + q, len(knots) + q))
        system[: len(knots)] = terms
        system[len(knots) :, : len(knots)] = terms[:, len(knots) :].T
        target = np.zeros((len(system), len(self.states)))
        target[1 : len(knots)] = np.eye(len(self.states))
        return np.asarray(np.linalg.solve(system, target))

    def _terms(self, z: Float) -> Float:
        """(t, s + 1 + q) at coordinates (t, r)."""
        square = ((z[:, None] - self._knots) ** 2).sum(2)
        return np.concatenate([square * np.sqrt(square), _monomials(z, self._powers)], axis=1)


def _monomials(z: Float, powers: Float) -> Float:
    return np.asarray(np.prod(z[:, None] ** powers, axis=2))
