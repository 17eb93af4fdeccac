"""Expected squared error of a layout with the decoder eliminated, its gradient and curvature.

Variable projection (Golub & Pereyra 1973): the ridge with the features Phi and the noise weight of
`sensing/decoder.py` is the least squares problem |A beta - B|^2, A being the centred features over
the features' slopes times the noise, B the centred outputs over zeros. At the optimal beta the
gradient by a parameter is 2 <dA beta, A beta - B>, and with Kaufman's Jacobian (I - P) dA beta
(BIT 15, 1975), P the projection onto A's columns, the Gauss-Newton matrix is its Gram matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..sensing.decoder import regular
from .freedom import CordFreedom
from .problem import Problem


@dataclass(frozen=True)
class Model:
    """Mean squared marker error (mm^2), its gradient (size,), Gauss-Newton matrix (size, size)."""

    value: float
    gradient: Float
    hessian: Float


class Objective:
    """Mean squared marker error as a function of all cords' parameters."""

    def __init__(self, problem: Problem, cords: Sequence[CordFreedom]) -> None:
        self.problem, self.cords = problem, cords
        self._outputs = problem.outputs
        self._square = float((self._outputs**2).sum())
        self._features = problem.features(len(cords))
        self._bent = bool(self._features.second.any())
        self._noise = max(problem.noise, self._features.least_noise)
        self._ends = np.cumsum([0, *(c.size for c in cords)])
        self._first = np.cumsum([0, *(len(c.points(np.zeros(c.size))) for c in cords)])

    def split(self, x: Float) -> list[Float]:
        return [x[a:b] for a, b in zip(self._ends[:-1], self._ends[1:], strict=True)]

    def value(self, x: Float) -> float:
        """Value at parameters x (size,)."""
        return self.of_signals(self._with_rest(self._tape(x)[0]))[0]

    def __call__(self, x: Float) -> tuple[float, Float]:
        """Value and gradient (size,) at parameters x (size,)."""
        signals, slopes = self._tape(x)
        value, by_signals = self.of_signals(self._with_rest(signals))
        jacobians = self._jacobians(x, slopes())
        return value, np.concatenate(
            [j @ w for j, w in zip(jacobians, by_signals[1:].T, strict=True)]
        )

    def model(self, x: Float) -> Model:
        """The quadratic model at parameters x (size,)."""
        signals, slopes = self._tape(x)
        S = self._with_rest(signals)
        jacobians = self._jacobians(x, slopes())
        n, m = S.shape
        phi, bend = self._features(S), self._features.slopes(S)
        A, B = phi - phi.mean(0), self._outputs
        A = np.concatenate([A, self._noise * bend.transpose(0, 2, 1).reshape(n * m, -1)])
        B = np.concatenate([B, np.zeros((n * m, B.shape[1]))])
        Q, R = np.linalg.qr(A)
        beta = np.linalg.lstsq(R, Q.T @ B, rcond=1e-12)[0]
        residual = A @ beta - B
        by_signal = np.einsum("nfc,fr->cnr", bend, beta)
        by_slope = self._noise * np.einsum("fcd,fr->cdr", self._features.second, beta)
        changes = []
        for j, one, two in zip(jacobians, by_signal, by_slope, strict=True):
            change = np.zeros((len(j), *residual.shape))
            change[:, 1:n] = j[:, :, None] * one[1:]  # rest has no signal to change
            change[:, :n] -= change[:, :n].mean(1, keepdims=True)
            if self._bent:
                rows = j[:, :, None, None] * two
                change[:, n + m :] = rows.reshape(len(j), (n - 1) * m, residual.shape[1])
            changes.append(change)
        change = np.concatenate(changes)
        gradient = change.reshape(len(change), -1) @ residual.ravel()
        change -= Q @ (Q.T @ change)
        flat = change.reshape(len(change), -1)
        return Model(
            float((residual**2).sum() / n), 2 / n * gradient, np.asarray(2 / n * flat @ flat.T)
        )

    def of_signals(self, S: Float) -> tuple[float, Float]:
        """Value and derivative (n, c) at signals (n, c)."""
        n = len(S)
        phi, slopes = self._features(S), self._features.slopes(S)
        centred = phi - phi.mean(0)
        flat = slopes.transpose(1, 0, 2).reshape(len(slopes[0]), -1)
        variance = self._noise**2
        normal = centred.T @ centred + variance * (flat @ flat.T)
        right = centred.T @ self._outputs
        beta = np.linalg.solve(regular(normal), right)
        value = (self._square - (right * beta).sum()) / n
        # Rows of the residual sum to zero: centring drops out.
        by_phi = (centred @ beta - self._outputs) @ beta.T
        by_signals = np.einsum("nf,nfc->nc", by_phi, slopes)
        if self._bent:
            by_slopes = variance * (beta @ beta.T @ slopes)
            by_signals += np.einsum("nfd,fcd->nc", by_slopes, self._features.second)
        return float(value), 2 / n * by_signals

    def _tape(self, x: Float):  # type: ignore[no-untyped-def]
        points = [c.points(part) for c, part in zip(self.cords, self.split(x), strict=True)]
        return self.problem.carrier.tape(np.concatenate(points), self._first)

    def _jacobians(self, x: Float, slopes: Float) -> list[Float]:
        """Derivatives (size, s) of each cord's signals by its parameters."""
        parts = zip(self.cords, self.split(x), self._first[:-1], self._first[1:], strict=True)
        return [c.pull(part, slopes[a:b]) for c, part, a, b in parts]

    @staticmethod
    def _with_rest(signals: Float) -> Float:
        return np.concatenate([np.zeros((1, signals.shape[1])), signals])
