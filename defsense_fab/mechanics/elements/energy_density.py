"""Compute energy density, first Piola-Kirchhoff stress and tangent of a deformation gradient F.

All follow from the derivatives of the law in `material.py` by the chain rule, with dI1/dF = 2 F,
dI2/dF = 2 (I1 F - F F^T F) and dJ/dF = cof F. The tangent is made positive semidefinite through the
eigensystem of isotropic energies in the principal stretches, which needs no eigenvalues of a 9 x 9
matrix (Smith, De Goes & Kim 2019, "Analytic Eigensystems for Isotropic Distortion Energies").

The loops over tets in `tet10.py` use the same compiled functions, `kernels/energy_density.c`.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.machine import kernels
from .material import Material


def energy_density(material: Material, F: Float) -> float:
    """Return the energy density W(F) at F (3, 3), MPa, infinite outside the material's domain."""
    out = np.empty(1)
    kernels.energy_density(material.law, F, out)
    return float(out[0])


def stress(material: Material, F: Float) -> Float:
    """Return the stress dW/dF (3, 3) at F (3, 3), MPa."""
    out = np.empty((3, 3))
    kernels.stress(material.law, F, out)
    return out


def tangent(material: Material, F: Float, lag: float = 0.0, share: float = 0.0) -> Float:
    """Return the tangent d2W/dF2 (9, 9), MPa; row 3 i + j belongs to F_ij.

    Args:
        material: The material.
        F: Deformation gradient (3, 3).
        lag: Difference of the pressure that multiplies d2J/dF2 from the pressure at F, MPa.
        share: Share (0 to 1) of the negative part of the tangent that is removed.
    """
    out = np.empty((9, 9))
    kernels.tangent(material.law, F, lag, share, out)
    return out


def symmetric_eigen(A: Float) -> tuple[Float, Float]:
    """Return eigenvalues (3,) and eigenvectors (columns of a rotation) of a symmetric A (3, 3)."""
    w, V = np.empty(3), np.empty((3, 3))
    kernels.symmetric_eigen(A.copy(), w, V)
    return w, V


def signed_svd(F: Float) -> tuple[Float, Float, Float]:
    """Factor F (3, 3) into U diag(s) V^T with rotations U and V.

    Returns:
        U, s and V; the singular values s (3,) decrease, and the smallest carries the sign of det F.
    """
    U, s, V = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    kernels.signed_svd(F, U, s, V)
    return U, s, V
