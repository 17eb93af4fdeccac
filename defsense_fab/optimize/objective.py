"""Expected squared error of a layout with the decoder eliminated, and its gradient.

Variable projection (Golub & Pereyra 1973): at the optimal beta the derivative by the signals
is 2 (S beta - O) beta^T.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ..core.arrays import Float
from ..sensing.signal import signal_gradient
from .freedom import CordFreedom
from .problem import Problem


class Objective:
    """Mean squared marker error (mm^2) as a function of all cords' parameters."""

    def __init__(self, problem: Problem, cords: Sequence[CordFreedom]) -> None:
        self.problem, self.cords = problem, cords
        self._outputs = problem.outputs()
        self._ends = np.cumsum([0, *(c.size for c in cords)])

    def split(self, x: Float) -> list[Float]:
        return [x[a:b] for a, b in zip(self._ends[:-1], self._ends[1:], strict=True)]

    def __call__(self, x: Float) -> tuple[float, Float]:
        """Value and gradient (size,) at parameters x (size,)."""
        p = self.problem
        paths = [c.path(part) for c, part in zip(self.cords, self.split(x), strict=True)]
        sizes = np.cumsum([0, *(len(points) for points, _ in paths)])
        rest = np.concatenate([points for points, _ in paths])
        at = p.locator.find(rest)
        deformed = rest + p.locator.displacement(at, p.fields)
        gradient = np.eye(3) + p.locator.gradient(at, p.fields)
        columns, by_rest = [], []
        for a, b in itertools.pairwise(sizes):
            s, g = signal_gradient(rest[a:b], deformed[:, a:b], gradient[:, a:b], p.gauge_factor)
            columns.append(np.concatenate([[0.0], s]))
            by_rest.append(g)
        S = np.stack(columns, axis=1)
        S = S - S.mean(0)
        beta = np.linalg.solve(S.T @ S + p.ridge * np.eye(S.shape[1]), S.T @ self._outputs)
        residual = S @ beta - self._outputs
        n = len(S)
        value = ((residual**2).sum() + p.ridge * (beta**2).sum()) / n
        by_signal = 2 / n * residual @ beta.T  # rows of residual sum to zero: centring drops out
        out = [
            np.einsum("s,spj,pjx->x", by_signal[1:, c], by_rest[c], paths[c][1])
            for c in range(len(self.cords))
        ]
        return float(value), np.concatenate(out)
