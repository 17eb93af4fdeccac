"""Compute the expected squared error of a layout with the decoder eliminated, and derivatives.

Variable projection (Golub & Pereyra 1973): the ridge with the features Phi and the noise weight of
`decoding/ridge.py` is the least squares problem |A beta - B|^2, A being the centred features over
the features' slopes times the noise, B the centred outputs over zeros. At the optimal beta the
gradient by a parameter is 2 <dA beta, A beta - B>, and with Kaufman's Jacobian (I - P) dA beta
(BIT 15, 1975), P the projection onto A's columns, the Gauss-Newton matrix is its Gram matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...decoding.elimination import expected_square, expected_square_gradient
from .cord_kinematics import PlacedCord, place_cord
from .cord_parameters import CordParameters
from .cord_signals import CarriedCords
from .problem import Problem


@dataclass(frozen=True)
class QuadraticModel:
    """A quadratic model of the objective.

    Attributes:
        value: Mean squared marker error, mm^2.
        gradient: (size,), its gradient by the parameters.
        hessian: (size, size), the Gauss-Newton matrix.
    """

    value: float
    gradient: Float
    hessian: Float


class Objective:
    """Mean squared marker error as a function of all cords' parameters.

    Args:
        problem: The problem.
        cords: Parameters of the cords of a layout.
    """

    def __init__(self, problem: Problem, cords: Sequence[CordParameters]) -> None:
        self.problem, self.cords = problem, cords
        self._outputs = problem.outputs
        self._features = problem.features(len(cords))
        self._bent = bool(self._features.hessian.any())
        self._noise = float(self._features.uncertainty(problem.noise))
        self._ends = np.cumsum([0, *(c.size for c in cords)])
        self._first = np.cumsum([0, *(len(c.basis) for c in cords)])

    def split(self, x: Float) -> list[Float]:
        """Split parameters x (size,) into those of each cord."""
        return [x[a:b] for a, b in zip(self._ends[:-1], self._ends[1:], strict=True)]

    def value(self, x: Float) -> float:
        """Return the value, mm^2, at parameters x (size,)."""
        signals = _prepend_rest(self._carry(x)[1].signals)
        square = expected_square(self._features, signals, self._outputs, self._noise)
        return float(square) / len(signals)

    def __call__(self, x: Float) -> tuple[float, Float]:
        """Return value and gradient (size,) at parameters x (size,).

        It serves methods that need no curvature; descents use `model`.
        """
        placed, carried = self._carry(x)
        signals = _prepend_rest(carried.signals)
        square, slopes = expected_square_gradient(
            self._features, signals, self._outputs, self._noise
        )
        by_points = carried.pull(slopes[1:] / len(signals))
        pulled = [p.pull_one(by_points[a:b]) for p, a, b in self._parts(placed)]
        return square / len(signals), np.concatenate(pulled)

    def model(self, x: Float) -> QuadraticModel:
        """Return the quadratic model at parameters x (size,)."""
        S, slopes = self.signals(x)
        jacobians = slopes()
        n, m = S.shape
        phi, bend = self._features(S), self._features.slopes(S)
        A, B = phi - phi.mean(0), self._outputs
        if self._bent:
            noise = self._noise * bend.transpose(0, 2, 1).reshape(n * m, -1)
        else:  # the slopes of all samples are equal, and so are their rows
            noise = np.sqrt(n) * self._noise * bend[0].T
        A = np.concatenate([A, noise])
        B = np.concatenate([B, np.zeros((len(noise), B.shape[1]))])
        Q, R = np.linalg.qr(A)
        beta = np.linalg.lstsq(R, Q.T @ B, rcond=1e-12)[0]
        residual = A @ beta - B
        by_signal = np.einsum("nfc,fr->cnr", bend, beta)
        by_slope = self._noise * np.einsum("fcd,fr->cdr", self._features.hessian, beta)
        changes = []
        for j, one, two in zip(jacobians, by_signal, by_slope, strict=True):
            change = np.zeros((len(j), *residual.shape))
            change[:, 1:n] = j[:, :, None] * one[1:]  # the signals of rest are zero
            change[:, :n] -= change[:, :n].mean(1, keepdims=True)
            if self._bent:
                rows = j[:, :, None, None] * two
                change[:, n + m :] = rows.reshape(len(j), (n - 1) * m, residual.shape[1])
            changes.append(change)
        change = np.concatenate(changes)
        gradient = change.reshape(len(change), -1) @ residual.ravel()
        change -= Q @ (Q.T @ change)
        flat = change.reshape(len(change), -1)
        return QuadraticModel(
            float((residual**2).sum() / n), 2 / n * gradient, np.asarray(2 / n * flat @ flat.T)
        )

    def signals(self, x: Float) -> tuple[Float, Callable[[], list[Float]]]:
        """Return the signals at parameters x (size,) and a function for their derivatives.

        Returns:
            Signals (n, c), rest first, and a function that returns for each cord the derivatives
            (size of the cord, n - 1) of its signals in the other states by its parameters.
        """
        placed, carried = self._carry(x)

        def jacobians() -> list[Float]:
            slopes = carried.slopes()
            return [p.pull(slopes[a:b]) for p, a, b in self._parts(placed)]

        return _prepend_rest(carried.signals), jacobians

    def _carry(self, x: Float) -> tuple[list[PlacedCord], CarriedCords]:
        placed = [place_cord(c, part) for c, part in zip(self.cords, self.split(x), strict=True)]
        points = np.concatenate([p.points for p in placed])
        return placed, self.problem.carrier.carry(points, self._first)

    def _parts(self, placed: list[PlacedCord]) -> Iterator[tuple[PlacedCord, int, int]]:
        """Iterate over the cords with the range of their points."""
        return zip(placed, self._first[:-1].tolist(), self._first[1:].tolist(), strict=True)


def _prepend_rest(signals: Float) -> Float:
    return np.concatenate([np.zeros((1, signals.shape[1])), signals])
