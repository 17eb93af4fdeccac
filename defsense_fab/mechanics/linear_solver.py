"""Symmetric sparse solves: MKL Pardiso where there is MKL, SciPy's SuperLU elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl

from ..core.arrays import Float


class NotPositiveDefinite(Exception):
    """The Cholesky factorisation met a pivot that is not positive."""


class SymmetricSolver:
    """Solves with matrices of one sparsity pattern, given as upper triangles (CSR)."""

    def __init__(self) -> None:
        try:
            import pypardiso

            self._pardiso: Any = pypardiso.PyPardisoSolver(mtype=2)
        except ImportError:  # no MKL on this platform
            self._pardiso = None
        self._analysed = False

    def solve(self, upper: Any, right: Float) -> Float:
        """x with A x = right, (n,). Raises NotPositiveDefinite."""
        if self._pardiso is None:
            full = (upper + sp.triu(upper, 1).T).tocsc()
            factor = spl.splu(full, diag_pivot_thresh=0.0, options={"SymmetricMode": True})
            if (factor.U.diagonal() <= 0).any():
                raise NotPositiveDefinite
            return np.asarray(factor.solve(right))
        from pypardiso.pardiso_wrapper import PyPardisoError

        right = np.ascontiguousarray(right).reshape(-1, 1)
        try:
            # The public factorize() analyses anew each time; the phases can be called alone.
            self._pardiso.set_phase(22 if self._analysed else 12)
            self._pardiso._call_pardiso(upper, right)
            self._analysed = True
            self._pardiso.set_phase(33)
            return np.asarray(self._pardiso._call_pardiso(upper, right)).ravel()
        except PyPardisoError as error:
            if "-4" in str(error):
                raise NotPositiveDefinite from None
            raise

    def close(self) -> None:
        """Release the factor's memory."""
        if self._pardiso is not None:
            self._pardiso.free_memory(everything=True)
