"""Expected squared error of a layout with the decoder eliminated, and its gradient.

Variable projection (Golub & Pereyra 1973): with the features Phi and the noise weight W of
`sensing/decoder.py`, the derivative at the optimal beta is 2 (Phi beta - O) beta^T by Phi and
beta beta^T by W.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.arrays import Float
from ..sensing.decoder import LEAST_NOISE
from .freedom import CordFreedom
from .problem import Problem


class Objective:
    """Mean squared marker error (mm^2) as a function of all cords' parameters."""

    def __init__(self, problem: Problem, cords: Sequence[CordFreedom]) -> None:
        self.problem, self.cords = problem, cords
        self._outputs = problem.outputs
        self._square = float((self._outputs**2).sum())
        self._features = problem.features(len(cords))
        self._ends = np.cumsum([0, *(c.size for c in cords)])
        self._first = np.cumsum([0, *(len(c.points(np.zeros(c.size))) for c in cords)])

    def split(self, x: Float) -> list[Float]:
        return [x[a:b] for a, b in zip(self._ends[:-1], self._ends[1:], strict=True)]

    def __call__(self, x: Float) -> tuple[float, Float]:
        """Value and gradient (size,) at parameters x (size,)."""
        p, parts = self.problem, self.split(x)
        points = np.concatenate([c.points(part) for c, part in zip(self.cords, parts, strict=True)])
        signals, pull = p.carrier.tape(points, self._first)
        S = np.concatenate([np.zeros((1, len(parts))), signals])
        value, by_signals = self.of_signals(S)
        by_points = pull(by_signals[1:])
        out = [
            c.pull(part, by_points[a:b])
            for c, part, a, b in zip(
                self.cords, parts, self._first[:-1], self._first[1:], strict=True
            )
        ]
        return value, np.concatenate(out)

    def of_signals(self, S: Float) -> tuple[float, Float]:
        """Value and derivative (n, c) at signals (n, c)."""
        p, n = self.problem, len(S)
        phi, slopes = self._features(S), self._features.slopes(S)
        centred = phi - phi.mean(0)
        flat = slopes.transpose(1, 0, 2).reshape(len(slopes[0]), -1)
        variance = max(p.noise, LEAST_NOISE) ** 2
        normal = centred.T @ centred + variance * (flat @ flat.T)
        right = centred.T @ self._outputs
        beta = np.linalg.solve(normal, right)
        value = (self._square - (right * beta).sum()) / n
        # Rows of the residual sum to zero: centring drops out.
        by_phi = (centred @ beta - self._outputs) @ beta.T
        by_signals = np.einsum("nf,nfc->nc", by_phi, slopes)
        if self._features.second.any():
            by_slopes = variance * (beta @ beta.T @ slopes)
            by_signals += np.einsum("nfd,fcd->nc", by_slopes, self._features.second)
        return float(value), 2 / n * by_signals
