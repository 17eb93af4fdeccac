"""Symmetric positive definite sparse solves behind one interface.

MKL Pardiso where there is MKL (x86); else RSLAB, which is about as quick and has wheels for every
system; else SciPy's SuperLU, several times slower (`python -m benchmarks.solvers`). The environment
variable DEFSENSE_SOLVER chooses another one of them.
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
    """Factors matrices of one sparsity pattern, given as upper triangles (CSR), and solves."""

    name: str

    def factor(self, upper: Any) -> None:
        """Keep the factor of a matrix. Raises NotPositiveDefinite."""

    def solve(self, right: Float) -> Float:
        """x (n,) or (n, k) with A x = right."""

    def close(self) -> None:
        """Release the factor's memory."""


def make_solver(threads: int = 1) -> SymmetricSolver:
    """The fastest solver of this machine, or the one that DEFSENSE_SOLVER names. Raises SolveError
    where that one is not to be had."""
    asked = os.environ.get("DEFSENSE_SOLVER")
    if asked and asked not in _KINDS:
        raise SolveError(
            f"{asked!r} is not one of {', '.join(_KINDS)}",
            code="unknown-solver",
            where="DEFSENSE_SOLVER",
            action="Set one of these, or unset the variable",
            solver=asked,
        )
    for name in [asked] if asked else _KINDS:
        try:
            return _KINDS[name](threads)
        except ImportError as error:
            if asked:
                raise SolveError(
                    f"{name} cannot be used ({error})",
                    code="solver-not-installed",
                    where="DEFSENSE_SOLVER",
                    action="Install it, or unset the variable",
                    solver=name,
                ) from None
    raise AssertionError("SciPy is there")


@cache
def _library() -> Any:
    """A pypardiso solver that found MKL; left alone each searches the whole environment for 1 s."""
    import pypardiso

    try:
        found = [
            f.locate()
            for f in files("mkl") or ()
            if "mkl_rt" in f.name and (".so" in f.name or f.suffix == ".dll")
        ]
    except PackageNotFoundError:
        found = []
    before = os.environ.get("PYPARDISO_MKL_RT")
    if found and before is None:
        os.environ["PYPARDISO_MKL_RT"] = str(found[0])
    try:
        return pypardiso.PyPardisoSolver(mtype=2)
    finally:
        if before is None:
            os.environ.pop("PYPARDISO_MKL_RT", None)


class Pardiso:
    """MKL Pardiso by Cholesky; the analysis is made once, then only phases 22 and 33 run."""

    name = "MKL Pardiso"

    def __init__(self, threads: int = 1) -> None:
        self._solver: Any = copy.copy(_library())
        for name in ("pt", "iparm", "perm"):  # what a solver of its own must not share
            setattr(self._solver, name, getattr(self._solver, name).copy())
        self._solver.set_iparm(1, 1)
        self._solver.set_iparm(2, 2)  # nested dissection
        self._solver.set_iparm(24, 1)  # two-level parallel factorisation
        self._threads = threads
        self._matrix: Any = None

    def _call(self, phase: int, right: Float) -> Float:
        from pypardiso.pardiso_wrapper import PyPardisoError

        # The public factorize() analyses anew each time; the phases can be called alone.
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
        if self._matrix is not None:  # releasing what was never analysed is an error to Pardiso
            self._solver.free_memory(everything=True)
            self._matrix = None


class Rslab:
    """RSLAB's L D L^T; analysed once. Any number of threads gives the same digits."""

    name = "RSLAB"

    def __init__(self, threads: int = 1) -> None:
        import rslab

        self._analyse = rslab.analyze
        self._threads = threads
        self._symbolic: Any = None
        self._factor: Any = None

    def factor(self, upper: Any) -> None:
        upper.sort_indices()  # where they are not
        if self._symbolic is None:
            self._symbolic = self._analyse(upper.T, path="ldlt", threads=self._threads)
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
    """SciPy's SuperLU in symmetric mode, on every platform."""

    name = "SciPy SuperLU"

    def __init__(self, threads: int = 1) -> None:  # noqa: ARG002 - it takes one alone
        self._factor: Any = None
        self._in_order = False  # whether the factor is of the matrix in that order
        self._order: Any = None  # (n,), by which little fills in: found once, as the analysis is

    def factor(self, upper: Any) -> None:
        full = (upper + sp.triu(upper, 1).T).tocsc()
        known = self._order is not None and len(self._order) == full.shape[0]
        try:
            factor = spl.splu(
                full[self._order][:, self._order] if known else full,
                permc_spec="NATURAL" if known else "MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:  # exactly singular
            raise NotPositiveDefinite from None
        if (factor.U.diagonal() <= 0).any():
            raise NotPositiveDefinite
        if not known:
            self._order = np.argsort(factor.perm_c)
        self._factor, self._in_order = factor, known

    def solve(self, right: Float) -> Float:
        if not self._in_order:
            return np.asarray(self._factor.solve(right))
        x = np.empty_like(right, dtype=float)
        x[self._order] = self._factor.solve(right[self._order])
        return x

    def close(self) -> None:
        self._factor = None


#: The fastest first.
_KINDS: Mapping[str, Callable[[int], SymmetricSolver]] = {
    "pardiso": Pardiso,
    "rslab": Rslab,
    "superlu": SuperLU,
}


def solver_name() -> str:
    """The name of what `make_solver` gives."""
    solver = make_solver()
    return solver.name
