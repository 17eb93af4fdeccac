"""Check that sequential quadratic programming ignores unsolved programs."""

from typing import Any

import daqp
import numpy as np
import pytest

from defsense_fab.optimize.problem.objective import QuadraticModel
from defsense_fab.optimize.refinement.sqp import minimize


def _bowl(x: np.ndarray) -> QuadraticModel:
    return QuadraticModel(value=1 + float(x @ x), gradient=2 * x, hessian=2 * np.eye(len(x)))


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
    found = minimize(
        _bowl,
        lambda x: _bowl(x).value,
        lambda x: (x - 0.5, np.eye(2)),
        np.array([1.5, 1.2]),
        60,
    )
    assert given_up == [3, 3]
    assert np.allclose(found.x, 0.5, atol=1e-3)
