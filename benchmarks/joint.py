"""The paper's way to refine a layout: paths and map as unknowns of one Newton iteration.

DefSense (CHI 2016, Eqs. 4-8) minimises |S(p) beta - O|^2 + lambda^2 |beta|^2 over the curves'
control points p and the map beta together. Here as Gauss-Newton steps of a trust-region solver
(scipy.optimize.least_squares), with broken limits as quadratic penalties, which the paper leaves
to the user. A reference for tests and benchmarks.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from defsense_fab.core.device import Sensor
from defsense_fab.optimize.constraints import Constraints
from defsense_fab.optimize.freedom import CordFreedom
from defsense_fab.optimize.objective import Objective
from defsense_fab.optimize.problem import Problem


def refine(
    problem: Problem, sensors: tuple[Sensor, ...], iterations: int, penalty: float = 10.0
) -> tuple[tuple[Sensor, ...], float]:
    """The layout, and its mean squared error (mm^2), for the affine map; `penalty` in mm of error
    a mm of violation."""
    cords = [CordFreedom(s) for s in sensors]
    objective = Objective(problem, cords)
    limits = Constraints(problem.surface, problem.depth, problem.limits, cords)
    O = problem.outputs  # noqa: E741
    n, r, m = len(O), O.shape[1], len(cords)
    size = sum(c.size for c in cords)
    ridge = problem.noise * np.sqrt(n)

    def parts(v):  # type: ignore[no-untyped-def]
        x, beta = v[:size], v[size:].reshape(m, r)
        signals, slopes = objective._tape(x)
        S = np.concatenate([np.zeros((1, m)), signals])
        return x, beta, S - S.mean(0), slopes

    def residual(v):  # type: ignore[no-untyped-def]
        x, beta, S, _ = parts(v)
        broken = np.minimum(limits(x)[0], 0) * penalty
        return np.concatenate([(S @ beta - O).ravel(), ridge * beta.ravel(), broken])

    def jacobian(v):  # type: ignore[no-untyped-def]
        x, beta, S, slopes = parts(v)
        room, rows = limits(x)
        by_x = []
        for c, J in enumerate(objective._jacobians(x, slopes())):
            by = np.concatenate([np.zeros((len(J), 1)), J], axis=1)
            by = by - by.mean(1, keepdims=True)
            by_x.append((by[:, :, None] * beta[c]).reshape(len(J), n * r))
        top = np.hstack([np.concatenate(by_x).T, np.kron(S, np.eye(r))])
        middle = np.hstack([np.zeros((m * r, size)), ridge * np.eye(m * r)])
        below = np.hstack(
            [np.where(room[:, None] < 0, rows * penalty, 0), np.zeros((len(room), m * r))]
        )
        return np.concatenate([top, middle, below])

    start = np.concatenate([np.zeros(size), _map(problem, objective, size).ravel()])
    found = least_squares(
        residual, start, jacobian, method="trf", x_scale="jac", max_nfev=iterations
    )
    x = found.x[:size]
    layout = tuple(c.apply(p) for c, p in zip(cords, objective.split(x), strict=True))
    return layout, objective.value(x)


def _map(problem: Problem, objective: Objective, size: int) -> np.ndarray:
    signals, _ = objective._tape(np.zeros(size))
    S = np.concatenate([np.zeros((1, signals.shape[1])), signals])
    S = S - S.mean(0)
    weight = len(S) * problem.noise**2 * np.eye(S.shape[1])
    return np.linalg.solve(S.T @ S + weight, S.T @ problem.outputs)
