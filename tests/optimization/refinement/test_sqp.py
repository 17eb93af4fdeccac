"""Check that sequential quadratic programming ignores unsolved programs."""

from typing import Any

import daqp
import numpy as np
import pytest

from defsense_fab.optimization.problem.objective import QuadraticModel
from defsense_fab.optimization.refinement.sqp import minimize


class Bowl:
    """Minimize 1 + |x|^2 where each component is at least 0.5."""

    def model(self, x):
        return QuadraticModel(self.value(x), gradient=2 * x, hessian=2 * np.eye(len(x)))

    def value(self, x):
        return 1 + float(x @ x)

    def inequalities(self, x):
        return x - 0.5, np.eye(len(x))

    def guard(self, x, trial):
        return None


def test_an_unsolved_program_only_shrinks_the_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """daqp returns uninitialized arrays for a program that it cannot solve."""
    solve, given_up = daqp.solve, []

    def sometimes(H: np.ndarray, *rest: Any) -> Any:
        if len(given_up) < 2:
            found, value, _, info = solve(H, *rest)
            given_up.append(len(H))
            return found * np.nan, value, -5, info | {"lam": np.full(len(info["lam"]), 1.7e308)}
        return solve(H, *rest)

    monkeypatch.setattr(daqp, "solve", sometimes)
    found = minimize(Bowl(), np.array([1.5, 1.2]), 60)
    assert given_up == [3, 3]
    assert np.allclose(found.x, 0.5, atol=1e-3)
