"""Solve symmetric positive definite sparse systems with any of three libraries.

MKL Pardiso is used where MKL is installed (x86), else RSLAB, which is about as fast and has wheels
for every system, else SciPy's SuperLU, which is several times slower
(`python -m benchmarks.solvers`). The environment variable DEFSENSE_SOLVER selects one of them.
"""

from __future__ import annotations

import copy
import ctypes
import os
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl

from ...core.arrays import Float
from ...core.errors import SolveError


class NotPositiveDefinite(Exception):
    """The Cholesky factorisation met a pivot that is not positive."""


class SymmetricSolver(Protocol):
    """A solver for matrices of one sparsity pattern, given as upper triangles (CSR).

    Attributes:
        name: Name of the library, for people.
    """

    name: str

    def factor(self, upper: Any) -> None:
        """Factor a matrix and keep the factor.

        Raises:
            NotPositiveDefinite: If the matrix is not positive definite.
        """

    def solve(self, right: Float) -> Float:
        """Return x (n,) or (n, k) with A x = right."""

    def close(self) -> None:
        """Release the factor's memory."""


def make_solver(threads: int = 1) -> SymmetricSolver:
    """Create the fastest solver of this machine, or the one that DEFSENSE_SOLVER names.

    Args:
        threads: Number of threads the solver may use.

    Raises:
        SolveError: If DEFSENSE_SOLVER names an unknown solver or one that is not installed.
    """
    requested = os.environ.get("DEFSENSE_SOLVER")
    if requested and requested not in _SOLVERS:
        raise SolveError(
            f"{requested!r} is not one of {', '.join(_SOLVERS)}",
            code="unknown-solver",
            where="DEFSENSE_SOLVER",
            action="Set one of these, or unset the variable",
            solver=requested,
        )
    for name in [requested] if requested else _SOLVERS:
        try:
            return _SOLVERS[name](threads)
        except ImportError as error:
            if requested:
                raise SolveError(
                    f"{name} cannot be used ({error})",
                    code="solver-not-installed",
                    where="DEFSENSE_SOLVER",
                    action="Install it, or unset the variable",
                    solver=name,
                ) from None
    raise AssertionError("SciPy is always installed")


@cache
def _pypardiso_solver() -> Any:
    """Create a pypardiso solver with the path of MKL set.

    Without the path, the import searches the whole environment, which takes 1 s.
    """
    try:
        libraries = [
            f.locate()
            for f in files("mkl") or ()
            if "mkl_rt" in f.name and (".so" in f.name or f.suffix == ".dll")
        ]
    except PackageNotFoundError:
        libraries = []
    before = os.environ.get("PYPARDISO_MKL_RT")
    if libraries and before is None:
        os.environ["PYPARDISO_MKL_RT"] = str(libraries[0])
    try:
        import pypardiso

        return pypardiso.PyPardisoSolver(mtype=2)
    finally:
        if before is None:
            os.environ.pop("PYPARDISO_MKL_RT", None)


class Pardiso:
    """Cholesky factorization by MKL Pardiso.

    The analysis runs once; afterwards only phases 22 (factor) and 33 (solve) run.
    """

    name = "MKL Pardiso"

    def __init__(self, threads: int = 1) -> None:
        self._solver: Any = copy.copy(_pypardiso_solver())
        for name in ("pt", "iparm", "perm"):  # must not be shared between solvers
            setattr(self._solver, name, getattr(self._solver, name).copy())
        self._solver.set_iparm(1, 1)
        self._solver.set_iparm(2, 2)  # nested dissection
        self._solver.set_iparm(24, 1)  # two-level parallel factorization
        self._threads = threads
        self._matrix: Any = None

    def _call(self, phase: int, right: Float) -> Float:
        from pypardiso.pardiso_wrapper import PyPardisoError

        # The public factorize() repeats the analysis each time; single phases can be called.
        self._solver.set_phase(phase)
        before = self._solver.libmkl.MKL_Set_Num_Threads_Local(ctypes.c_int(self._threads))
        try:
            return np.asarray(self._solver._call_pardiso(self._matrix, right))
        except PyPardisoError as error:
            if "-4" in str(error):
                raise NotPositiveDefinite from None
            raise
        finally:
            self._solver.libmkl.MKL_Set_Num_Threads_Local(ctypes.c_int(before))

    def factor(self, upper: Any) -> None:
        first = self._matrix is None
        self._matrix = upper
        self._call(12 if first else 22, np.zeros((upper.shape[0], 1)))

    def solve(self, right: Float) -> Float:
        columns = np.asfortranarray(right.reshape(len(right), -1))
        return self._call(33, columns).reshape(right.shape)

    def close(self) -> None:
        if self._matrix is not None:  # Pardiso fails if nothing was analyzed
            self._solver.free_memory(everything=True)
            self._matrix = None


class Rslab:
    """L D L^T factorization by RSLAB, analyzed once.

    Any number of threads gives the same digits.
    """

    name = "RSLAB"

    def __init__(self, threads: int = 1) -> None:
        import rslab

        self._analyze = rslab.analyze
        self._threads = threads
        self._symbolic: Any = None
        self._factor: Any = None

    def factor(self, upper: Any) -> None:
        upper.sort_indices()  # RSLAB requires sorted indices
        if self._symbolic is None:
            self._symbolic = self._analyze(upper.T, path="ldlt", threads=self._threads)
        try:
            factor = self._symbolic.factor(upper.data)
        except RuntimeError:  # singular, or not finite
            raise NotPositiveDefinite from None
        if factor.inertia[0] < upper.shape[0]:
            raise NotPositiveDefinite
        self._factor = factor

    def solve(self, right: Float) -> Float:
        if right.ndim == 1:
            return np.asarray(self._factor.solve(np.ascontiguousarray(right, float)))
        return np.asarray(self._factor.solve_many(np.ascontiguousarray(right, float)))

    def close(self) -> None:
        self._symbolic = self._factor = None


class SuperLU:
    """SciPy's SuperLU in symmetric mode, available on every platform."""

    name = "SciPy SuperLU"

    def __init__(self, threads: int = 1) -> None:  # noqa: ARG002 - SuperLU runs in one thread
        self._factor: Any = None
        self._is_ordered = False  # whether the factored matrix is permuted by the order
        self._order: Any = None  # (n,) fill-reducing order, found by the first factorization

    def factor(self, upper: Any) -> None:
        full = (upper + sp.triu(upper, 1).T).tocsc()
        has_order = self._order is not None and len(self._order) == full.shape[0]
        try:
            factor = spl.splu(
                full[self._order][:, self._order] if has_order else full,
                permc_spec="NATURAL" if has_order else "MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:  # exactly singular
            raise NotPositiveDefinite from None
        if (factor.U.diagonal() <= 0).any():
            raise NotPositiveDefinite
        if not has_order:
            self._order = np.argsort(factor.perm_c)
        self._factor, self._is_ordered = factor, has_order

    def solve(self, right: Float) -> Float:
        if not self._is_ordered:
            return np.asarray(self._factor.solve(right))
        x = np.empty_like(right, dtype=float)
        x[self._order] = self._factor.solve(right[self._order])
        return x

    def close(self) -> None:
        self._factor = None


#: The fastest first.
_SOLVERS: Mapping[str, Callable[[int], SymmetricSolver]] = {
    "pardiso": Pardiso,
    "rslab": Rslab,
    "superlu": SuperLU,
}


def solver_name() -> str:
    """Return the name of the solver that `make_solver` creates."""
    solver = make_solver()
    return solver.name
