"""Solve poses by FElupe: assembly in NumPy, plain Newton, MKL Pardiso if installed.

Its LinesearchPlugin needs fewer increments, but takes two to five times as long, and has converged
to another equilibrium.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import felupe
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from benchmarks.peers.problem import fractions

TOLERANCE = 1e-7  # of the free nodes' residual, relative to the reactions


def solve(
    nodes: np.ndarray,
    cells: np.ndarray,
    mu: float,
    kappa: float,
    fixed: np.ndarray,
    moved: np.ndarray,
    positions: Callable[[float], np.ndarray],
    increments: int | Sequence[float],
    folder: Path | None = None,
) -> tuple[np.ndarray, dict[str, Any]]:
    """Return displacements (n, 3) mm at full load, and statistics.

    Args:
        nodes: Nodes (n, 3) mm.
        cells: Quadratic tetrahedra (m, 10) in VTK's order.
        mu: Shear modulus, MPa.
        kappa: Bulk modulus, MPa.
        fixed: Indices of the fixed nodes.
        moved: Indices (k,) of the moved nodes.
        positions: Function of the load fraction t: displacements (k, 3) mm of the moved nodes.
        folder: Unused.

    Raises:
        RuntimeError: The solver does not converge.
    """
    steps = fractions(increments)
    region = felupe.RegionQuadraticTetra(felupe.Mesh(nodes, cells, "tetra10"))
    field = felupe.FieldContainer([felupe.Field(region, dim=3)])
    body = felupe.SolidBody(felupe.NeoHooke(mu=mu, bulk=kappa, parallel=True), field)
    prescribed = np.concatenate([fixed, moved])
    dof0 = (3 * prescribed[:, None] + np.arange(3)).ravel()
    dof1 = np.setdiff1d(np.arange(3 * len(nodes)), dof0)
    value = np.zeros((len(prescribed), 3))
    linear = _linear_solver()
    linear(sp.eye(3, format="csr"), np.ones(3))  # loads the solver's library
    iterations = 0
    start = time.perf_counter()
    for t in steps:
        value[len(fixed) :] = positions(t)
        try:
            with warnings.catch_warnings():  # of an inverted element; Newton reports the NaN
                warnings.filterwarnings("ignore", "invalid value", RuntimeWarning)
                result = felupe.newtonraphson(
                    x0=field,
                    items=[body],
                    dof0=dof0,
                    dof1=dof1,
                    ext0=value.ravel(),
                    solver=linear,
                    kwargs={"parallel": True},
                    maxiter=40,
                    tol=TOLERANCE,
                    verbose=0,
                )
        except (felupe.tools.NewtonConvergenceError, ArithmeticError) as error:
            raise RuntimeError(f"FElupe at load fraction {t:g}: {str(error).strip()}") from error
        field = result.x
        iterations += result.iterations
    seconds = time.perf_counter() - start
    stats = {
        "seconds": seconds,
        "iterations": iterations,
        "increments": len(steps),
        "version": f"felupe {felupe.__version__}, {linear.__name__}",
    }
    return field[0].values.copy(), stats


def _linear_solver() -> Callable[[Any, np.ndarray], np.ndarray]:
    """Return Pardiso for symmetric indefinite matrices, or SuperLU of SciPy without MKL."""
    try:
        import pypardiso
    except ImportError:
        return spsolve
    # Half the work of pypardiso.spsolve, which uses no symmetry and repeats the analysis of each
    # matrix.
    solver = pypardiso.PyPardisoSolver(mtype=-2)
    analysed = sp.csr_matrix((0, 0))

    def pardiso(matrix: Any, right: np.ndarray) -> np.ndarray:
        nonlocal analysed
        upper, right = sp.triu(matrix, format="csr"), right.reshape(-1, 1)
        same = upper.shape == analysed.shape and np.array_equal(upper.indices, analysed.indices)
        solver.set_phase(22 if same else 12)
        solver._call_pardiso(upper, right)
        solver.set_phase(33)
        analysed = upper
        return np.asarray(solver._call_pardiso(upper, right)).ravel()

    return pardiso
