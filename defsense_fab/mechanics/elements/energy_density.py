"""Compute energy density, first Piola-Kirchhoff stress and tangent of a deformation gradient F.

All follow from `material.evaluate_law` by the chain rule, with dI1/dF = 2 F,
dI2/dF = 2 (I1 F - F F^T F) and dJ/dF = cof F. The tangent is made positive semidefinite through the
eigensystem of isotropic energies in the principal stretches, which needs no eigenvalues of a 9 x 9
matrix (Smith, De Goes & Kim 2019, "Analytic Eigensystems for Isotropic Distortion Energies").
"""

from __future__ import annotations

import numpy as np

from ...core.machine.compiled import compiled
from .material import evaluate_law


@compiled(inline="always")
def cofactor(F, C):  # type: ignore[no-untyped-def]
    """Fill C with the cofactor of F, the derivative of det F by F, and return det F."""
    C[0, 0] = F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1]
    C[0, 1] = F[1, 2] * F[2, 0] - F[1, 0] * F[2, 2]
    C[0, 2] = F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0]
    C[1, 0] = F[2, 1] * F[0, 2] - F[2, 2] * F[0, 1]
    C[1, 1] = F[2, 2] * F[0, 0] - F[2, 0] * F[0, 2]
    C[1, 2] = F[2, 0] * F[0, 1] - F[2, 1] * F[0, 0]
    C[2, 0] = F[0, 1] * F[1, 2] - F[0, 2] * F[1, 1]
    C[2, 1] = F[0, 2] * F[1, 0] - F[0, 0] * F[1, 2]
    C[2, 2] = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    return F[0, 0] * C[0, 0] + F[0, 1] * C[0, 1] + F[0, 2] * C[0, 2]


@compiled(error_model="numpy")
def symmetric_eigen(A, w, V):  # type: ignore[no-untyped-def]
    """Compute eigenvalues w (3,) and eigenvectors (columns of the rotation V) of a symmetric A.

    A is overwritten.

    References:
        Cyclic Jacobi rotations: Golub & Van Loan, Matrix Computations, sec. 8.5.
    """
    V[:] = 0.0
    for i in range(3):
        V[i, i] = 1.0
    scale = abs(A[0, 0]) + abs(A[1, 1]) + abs(A[2, 2])
    for _ in range(30):
        if abs(A[0, 1]) + abs(A[0, 2]) + abs(A[1, 2]) <= 1e-15 * scale:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if A[p, q] == 0.0:
                    continue
                theta = (A[q, q] - A[p, p]) / (2 * A[p, q])
                t = 1 / (abs(theta) + np.sqrt(theta * theta + 1))
                if theta < 0:
                    t = -t
                c = 1 / np.sqrt(t * t + 1)
                s = t * c
                for k in range(3):
                    x, y = A[k, p], A[k, q]
                    A[k, p], A[k, q] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = A[p, k], A[q, k]
                    A[p, k], A[q, k] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = V[k, p], V[k, q]
                    V[k, p], V[k, q] = c * x - s * y, s * x + c * y
    for i in range(3):
        w[i] = A[i, i]


@compiled(error_model="numpy")
def signed_svd(F, U, s, V):  # type: ignore[no-untyped-def]
    """Factor F into U diag(s) V^T with rotations U and V.

    The singular values s (3,) decrease; the smallest carries the sign of det F.
    """
    A = F.T @ F
    symmetric_eigen(A, s, V)
    for i in range(2):  # largest first, V stays a rotation
        for j in range(2 - i):
            if s[j] < s[j + 1]:
                s[j], s[j + 1] = s[j + 1], s[j]
                for k in range(3):
                    V[k, j], V[k, j + 1] = V[k, j + 1], -V[k, j]
    for i in range(2):
        for k in range(3):
            U[k, i] = F[k, 0] * V[0, i] + F[k, 1] * V[1, i] + F[k, 2] * V[2, i]
        if i == 1:
            along = U[0, 0] * U[0, 1] + U[1, 0] * U[1, 1] + U[2, 0] * U[2, 1]
            for k in range(3):
                U[k, 1] -= along * U[k, 0]
        s[i] = np.sqrt(U[0, i] ** 2 + U[1, i] ** 2 + U[2, i] ** 2)
        for k in range(3):
            U[k, i] /= s[i]
    U[0, 2] = U[1, 0] * U[2, 1] - U[2, 0] * U[1, 1]
    U[1, 2] = U[2, 0] * U[0, 1] - U[0, 0] * U[2, 1]
    U[2, 2] = U[0, 0] * U[1, 1] - U[1, 0] * U[0, 1]
    s[2] = 0.0
    for i in range(3):
        for j in range(3):
            s[2] += U[i, 2] * F[i, j] * V[j, 2]


@compiled(inline="always")
def _invariants(F, C, B):  # type: ignore[no-untyped-def]
    """Return I1, I2 and J, and fill C = cof F and B = I1 F - F F^T F, half of dI2/dF."""
    J = cofactor(F, C)
    i1 = i2 = 0.0
    for i in range(3):
        for j in range(3):
            i1 += F[i, j] * F[i, j]
            i2 += C[i, j] * C[i, j]  # I2(F^T F) is the squared norm of the cofactor
    for i in range(3):
        for j in range(3):
            s = 0.0
            for k in range(3):
                for m in range(3):
                    s += F[i, k] * F[m, k] * F[m, j]
            B[i, j] = i1 * F[i, j] - s
    return i1, i2, J


@compiled(error_model="numpy")
def energy_density(kind, p, F, C, d):  # type: ignore[no-untyped-def]
    """Return the energy density W(F), MPa; `C` (3, 3) and `d` (10,) are scratch."""
    J = cofactor(F, C)
    i1 = i2 = 0.0
    for i in range(3):
        for j in range(3):
            i1 += F[i, j] * F[i, j]
            i2 += C[i, j] * C[i, j]
    evaluate_law(kind, p, i1, i2, J, d)
    return d[0]


@compiled(error_model="numpy")
def stress(kind, p, F, P, C, B, d):  # type: ignore[no-untyped-def]
    """Fill P (3, 3) with the stress dW/dF, MPa; `C`, `B` (3, 3) and `d` (10,) are scratch."""
    i1, i2, J = _invariants(F, C, B)
    evaluate_law(kind, p, i1, i2, J, d)
    for i in range(3):
        for j in range(3):
            P[i, j] = 2 * d[1] * F[i, j] + 2 * d[2] * B[i, j] + d[3] * C[i, j]


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def tangent(kind, p, F, lag, share, H, C, B, d):  # type: ignore[no-untyped-def]
    """Fill H (9, 9) with the tangent d2W/dF2, MPa; row 3 i + j belongs to F_ij.

    Args:
        kind: Family of the material.
        p: Parameters of the material.
        F: Deformation gradient (3, 3).
        lag: Difference of the pressure that multiplies d2J/dF2 from the pressure at F, MPa.
        share: Share (0 to 1) of the negative part of H that is removed.
        H: Result (9, 9).
        C: Scratch (3, 3).
        B: Scratch (3, 3).
        d: Scratch (10,).
    """
    i1, i2, J = _invariants(F, C, B)
    evaluate_law(kind, p, i1, i2, J, d)
    d[3] += lag
    f, b, c = F.ravel(), B.ravel(), C.ravel()
    for r in range(9):
        x = 4 * (d[4] * f[r] + d[5] * b[r]) + 2 * d[6] * c[r]
        y = 4 * (d[5] * f[r] + d[7] * b[r]) + 2 * d[8] * c[r]
        z = 2 * (d[6] * f[r] + d[8] * b[r]) + d[9] * c[r]
        for q in range(9):
            H[r, q] = x * f[q] + y * b[q] + z * c[q]
    for r in range(9):
        H[r, r] += 2 * d[1]
    # d2J/dF2: each entry of the cofactor is a difference of two products.
    for i in range(3):
        i1_, i2_ = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            r = 3 * i + j
            H[r, 3 * i1_ + j1] += d[3] * F[i2_, j2]
            H[r, 3 * i2_ + j2] += d[3] * F[i1_, j1]
            H[r, 3 * i1_ + j2] -= d[3] * F[i2_, j1]
            H[r, 3 * i2_ + j1] -= d[3] * F[i1_, j2]
    if d[2] != 0.0:  # d2I2/dF2
        g = F.T @ F
        h = F @ F.T
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    for m in range(3):
                        s = 2 * F[i, j] * F[k, m] - F[i, m] * F[k, j]
                        if i == k:
                            s -= g[j, m]
                            if j == m:
                                s += i1
                        if j == m:
                            s -= h[i, k]
                        H[3 * i + j, 3 * k + m] += 2 * d[2] * s
    if share > 0:
        _project(F, H, d, i1, share)


@compiled(error_model="numpy")
def _project(F, H, d, i1, share):  # type: ignore[no-untyped-def]
    """Raise the negative eigenvalues of H by a share of their distance from zero."""
    U, V, s = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    signed_svd(F, U, s, V)
    m = np.empty(9)
    for k in range(3):  # twist and flip modes: exact eigenvectors of H
        i, j = (k + 1) % 3, (k + 2) % 3
        for sign in (1.0, -1.0):
            value = 2 * d[1] + 2 * d[2] * (s[k] * s[k] + sign * s[i] * s[j]) + sign * d[3] * s[k]
            # sign +1: antisymmetric pair, (W_i + W_j) / (s_i + s_j); -1: symmetric pair.
            if value < 0:
                for r in range(3):
                    for c in range(3):
                        m[3 * r + c] = U[r, i] * V[c, j] - sign * U[r, j] * V[c, i]
                for r in range(9):
                    for c in range(9):
                        H[r, c] -= share * 0.5 * value * m[r] * m[c]
    A = np.empty((3, 3))
    a1, a2, a3 = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        a1[i] = 2 * s[i]
        a2[i] = 2 * s[i] * (i1 - s[i] * s[i])
        a3[i] = s[(i + 1) % 3] * s[(i + 2) % 3]
    for i in range(3):
        for j in range(3):
            A[i, j] = (
                d[4] * a1[i] * a1[j]
                + d[5] * (a1[i] * a2[j] + a2[i] * a1[j])
                + d[6] * (a1[i] * a3[j] + a3[i] * a1[j])
                + d[7] * a2[i] * a2[j]
                + d[8] * (a2[i] * a3[j] + a3[i] * a2[j])
                + d[9] * a3[i] * a3[j]
            )
            if i == j:
                A[i, i] += 2 * d[1] + 2 * d[2] * (i1 - s[i] * s[i])
            else:
                A[i, j] += 4 * d[2] * s[i] * s[j] + d[3] * s[3 - i - j]
    w, Q = np.empty(3), np.empty((3, 3))
    symmetric_eigen(A, w, Q)
    for k in range(3):
        if w[k] < 0:
            for r in range(3):
                for c in range(3):
                    m[3 * r + c] = 0.0
                    for i in range(3):
                        m[3 * r + c] += Q[i, k] * U[r, i] * V[c, i]
            for r in range(9):
                for c in range(9):
                    H[r, c] -= share * w[k] * m[r] * m[c]
