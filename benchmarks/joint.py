"""Refine a layout as the paper does: paths and map are unknowns of one Newton iteration.

DefSense (CHI 2016, Eqs. 4-8) minimizes |S(p) beta - O|^2 + lambda^2 |beta|^2 over the control
points p of the curves and the map beta together. Here a trust-region solver does so by Gauss-Newton
steps (scipy.optimize.least_squares). Violated limits are quadratic penalties; the paper leaves
limits to the user. Tests and benchmarks use this module as a reference.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from defsense_fab.core.device.device import Sensor
from defsense_fab.optimization.limits.constraints import Constraints
from defsense_fab.optimization.problem.cord_kinematics import place_cord
from defsense_fab.optimization.problem.cord_parameters import CordParameters
from defsense_fab.optimization.problem.objective import Objective
from defsense_fab.optimization.problem.problem import Problem


def system(problem: Problem, sensors: tuple[Sensor, ...], penalty: float):  # type: ignore[no-untyped-def]
    """Return the least-squares problem of a layout.

    Returns:
        The residual and its Jacobian as functions of (path parameters, map), the start (with the
        best map for the initial paths), and the objective whose map is eliminated.
    """
    cords = [CordParameters(s) for s in sensors]
    objective = Objective(problem, cords)
    limits = Constraints(problem.surface, problem.depth, problem.limits, cords)
    O = problem.outputs  # noqa: E741
    n, r, m = len(O), O.shape[1], len(cords)
    size = sum(c.size for c in cords)
    ridge = problem.features(m).uncertainty(problem.noise) * np.sqrt(n)

    def parts(v):  # type: ignore[no-untyped-def]
        x, beta = v[:size], v[size:].reshape(m, r)
        S, by_cord = objective.signals(x)
        return x, beta, S - S.mean(0), by_cord

    def residual(v):  # type: ignore[no-untyped-def]
        x, beta, S, _ = parts(v)
        broken = np.minimum(limits(x)[0], 0) * penalty
        return np.concatenate([(S @ beta - O).ravel(), ridge * beta.ravel(), broken])

    def jacobian(v):  # type: ignore[no-untyped-def]
        x, beta, S, by_cord = parts(v)
        room, rows = limits(x)
        by_x = []
        for c, J in enumerate(by_cord()):
            by = np.concatenate([np.zeros((len(J), 1)), J], axis=1)
            by = by - by.mean(1, keepdims=True)
            by_x.append((by[:, :, None] * beta[c]).reshape(len(J), n * r))
        top = np.hstack([np.concatenate(by_x).T, np.kron(S, np.eye(r))])
        middle = np.hstack([np.zeros((m * r, size)), ridge * np.eye(m * r)])
        below = np.hstack(
            [np.where(room[:, None] < 0, rows * penalty, 0), np.zeros((len(room), m * r))]
        )
        return np.concatenate([top, middle, below])

    _, _, S, _ = parts(np.zeros(size + m * r))
    beta = np.linalg.solve(S.T @ S + ridge**2 * np.eye(m), S.T @ O)
    return residual, jacobian, np.concatenate([np.zeros(size), beta.ravel()]), objective


def refine(
    problem: Problem, sensors: tuple[Sensor, ...], steps: int, penalty: float = 1.0
) -> tuple[Sensor, ...]:
    """Return the layout for the affine map after a number of steps.

    Args:
        problem: The design problem.
        sensors: The initial cords.
        steps: Largest number of evaluations.
        penalty: Error in mm per mm of violation.
    """
    residual, jacobian, start, objective = system(problem, sensors, penalty)
    solution = least_squares(residual, start, jacobian, method="trf", x_scale="jac", max_nfev=steps)
    x = solution.x[: sum(c.size for c in objective.cords)]
    return tuple(
        place_cord(c, p).sensor() for c, p in zip(objective.cords, objective.split(x), strict=True)
    )
