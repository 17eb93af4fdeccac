"""Solvers of sparse symmetric matrices."""

import numpy as np
import pytest
import scipy.sparse as sp

from defsense_fab.mechanics.solver import linear_solver
from defsense_fab.mechanics.solver.linear_solver import (
    NotPositiveDefinite,
    Pardiso,
    Rslab,
    SuperLU,
)


def random_spd(seed):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(20, 20))
    return sp.csr_matrix(np.triu(a @ a.T + np.eye(20))), rng.normal(size=20)


@pytest.mark.parametrize("unknowns", [0, 1000])
@pytest.mark.parametrize("kind", [Pardiso, Rslab, SuperLU])
def test_solvers_solve_definite_and_refuse_other_matrices(kind, unknowns, monkeypatch):
    monkeypatch.setattr(linear_solver, "MIN_SINGLE_UNKNOWNS", unknowns)
    solver = kind()
    for seed in range(3):  # one pattern, other values: the analysis is used again
        upper, right = random_spd(seed)
        solver.factor(upper)
        full = upper.toarray() + np.triu(upper.toarray(), 1).T
        assert full @ solver.solve(right) == pytest.approx(right, abs=1e-9)
        both = solver.solve(np.stack([right, 2 * right], axis=1))
        assert full @ both[:, 1] == pytest.approx(2 * right, abs=1e-9)
    solver.close()
    for other in (2.0, 1.0):  # indefinite, singular
        with pytest.raises(NotPositiveDefinite):
            kind().factor(sp.csr_matrix(np.array([[1.0, other], [0.0, 1.0]])))


def test_nearly_singular_matrices_are_solved_from_single_precision(monkeypatch):
    """Softer than the rounding of single precision: refused there, factored in double."""
    monkeypatch.setattr(linear_solver, "MIN_SINGLE_UNKNOWNS", 0)
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.normal(size=(30, 30)))[0]
    for softest in (1e-9, -1e-9):
        values = np.append(np.linspace(1, 2, 29), softest)
        full = axes * values @ axes.T
        solver = Pardiso()
        upper = sp.csr_matrix(np.triu((full + full.T) / 2))
        if softest < 0:
            with pytest.raises(NotPositiveDefinite):
                solver.factor(upper)
            continue
        solver.factor(upper)
        right = rng.normal(size=30)
        assert full @ solver.solve(right) == pytest.approx(right, abs=1e-6)
