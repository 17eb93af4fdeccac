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

#: Unknowns of a matrix from which it is factored in single precision, and the solve corrected.
MIN_SINGLE_UNKNOWNS = 60_000  # about 13,000 tets
#: Relative residuals of a solve, and of the solve that looks for directions of negative curvature.
SOLVE_RTOL, PROBE_RTOL = 1e-12, 1e-4
MAX_GRADIENT_STEPS = 40  # usually 2 to 6


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

    def solve(self, right: Float, rtol: float = SOLVE_RTOL) -> Float:
        """Return x (n,) or (n, k) with A x = right.

        Args:
            right: Right-hand sides (n,) or (n, k).
            rtol: Relative residual that suffices; direct solvers ignore it.

        Raises:
            NotPositiveDefinite: If that was not noticed by `factor`.
        """

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


class _PardisoHandle:
    """Cholesky factorizations by MKL Pardiso in one precision.

    The analysis runs once; afterwards only phases 22 (factor) and 33 (solve) run.
    """

    def __init__(self, threads: int, is_single: bool = False) -> None:
        self._solver: Any = copy.copy(_pypardiso_solver())
        for name in ("pt", "iparm", "perm"):  # must not be shared between solvers
            setattr(self._solver, name, getattr(self._solver, name).copy())
        self._solver.set_iparm(1, 1)
        self._solver.set_iparm(2, 2)  # nested dissection
        self._solver.set_iparm(24, 1)  # two-level parallel factorization
        self._solver.set_iparm(28, int(is_single))
        self._threads = threads
        self._dtype = np.float32 if is_single else np.float64
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
        self._call(12 if first else 22, np.zeros((upper.shape[0], 1), self._dtype))

    def solve(self, right: Float) -> Float:
        columns: Any = np.asfortranarray(right.reshape(len(right), -1), self._dtype)
        return self._call(33, columns).reshape(right.shape)

    def close(self) -> None:
        if self._matrix is not None:  # Pardiso fails if nothing was analyzed
            self._solver.free_memory(everything=True)
            self._matrix = None


class Pardiso:
    """Cholesky factorization by MKL Pardiso.

    A matrix of at least `MIN_SINGLE_UNKNOWNS` is scaled to a unit diagonal and factored in single
    precision, in 0.6 of the time and half of the memory. Conjugate gradients in double precision,
    with this factorization as the preconditioner, solve as exactly as a factorization in double
    precision. That takes over where they do not converge or meet a direction of negative curvature.

    References:
        Buttari et al. 2008, "Using Mixed Precision for Sparse Matrix Computations to Enhance the
        Performance while Achieving 64-bit Accuracy".
    """

    name = "MKL Pardiso"

    def __init__(self, threads: int = 1) -> None:
        self._single = _PardisoHandle(threads, is_single=True)
        self._double = _PardisoHandle(threads)
        self._matrix: Any = None
        self._scale: Float | None = None  # of a matrix that is factored in single precision

    def factor(self, upper: Any) -> None:
        self._matrix, self._scale = upper, None
        if upper.shape[0] >= MIN_SINGLE_UNKNOWNS:
            self._factor_in_single()
        if self._scale is None:
            self._double.factor(upper)

    def _factor_in_single(self) -> None:
        """Factor in single precision, and forget it if the matrix may not be positive definite."""
        diagonal = self._matrix.diagonal()
        if not (np.isfinite(diagonal) & (diagonal > 0)).all():
            return
        scale = 1 / np.sqrt(diagonal)
        rows = np.repeat(scale, np.diff(self._matrix.indptr))
        values = (self._matrix.data * rows * scale[self._matrix.indices]).astype(np.float32)
        scaled = sp.csr_matrix(
            (values, self._matrix.indices, self._matrix.indptr), shape=self._matrix.shape
        )
        try:
            self._single.factor(scaled)
        except NotPositiveDefinite:
            return
        self._scale = scale
        probe = np.random.default_rng(0).normal(size=len(scale)) / scale
        if self._conjugate_gradients(probe, PROBE_RTOL) is None:
            self._scale = None

    def solve(self, right: Float, rtol: float = SOLVE_RTOL) -> Float:
        if self._scale is not None:
            columns = right.reshape(len(right), -1)
            solved = [self._conjugate_gradients(column, rtol) for column in columns.T]
            found = [column for column in solved if column is not None]
            if len(found) == len(solved):
                return np.stack(found, axis=1).reshape(right.shape)
            self._scale = None
            self._double.factor(self._matrix)
        return self._double.solve(right)

    def _conjugate_gradients(self, right: Float, rtol: float) -> Float | None:
        """Return x (n,) with A x = right (n,), or None without convergence or with x A x < 0.

        Args:
            right: The right-hand side.
            rtol: Relative error in the energy norm.
        """
        upper, scale = self._matrix, self._scale
        diagonal, lower = upper.diagonal(), upper.T
        assert scale is not None
        x, residual = np.zeros_like(right), right.copy()
        direction, before, first = np.zeros_like(right), 1.0, 0.0
        for step in range(MAX_GRADIENT_STEPS):
            correction = scale * self._single.solve(scale * residual)
            # The square of the error's energy norm, which also weighs the softest deformations.
            product = float(residual @ correction)
            if not step:
                first = product
            if not np.isfinite(product) or product < 0:
                return None
            if product <= rtol**2 * first:
                return x + correction
            direction = correction + product / before * direction
            before = product
            image = upper @ direction + lower @ direction - diagonal * direction
            curvature = float(direction @ image)
            if not curvature > 0:
                return None
            x += product / curvature * direction
            residual -= product / curvature * image
        return None

    def close(self) -> None:
        self._single.close()
        self._double.close()
        self._matrix = self._scale = None


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

    def solve(self, right: Float, rtol: float = SOLVE_RTOL) -> Float:  # noqa: ARG002 - exact
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

    def solve(self, right: Float, rtol: float = SOLVE_RTOL) -> Float:  # noqa: ARG002 - exact
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
