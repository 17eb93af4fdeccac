"""3 x 3 matrices in compiled loops: cofactor, symmetric eigenvalues, singular values with signs."""

from __future__ import annotations

import numpy as np

from ...core.machine.compiled import compiled


@compiled(inline="always")
def cofactor(F, C):  # type: ignore[no-untyped-def]
    """Fill C with the cofactor of F (the derivative of det F by F); returns det F."""
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
def eigen(A, w, V):  # type: ignore[no-untyped-def]
    """Eigenvalues w (3,) and vectors (columns of V, a rotation) of the symmetric A, overwritten.

    Cyclic Jacobi rotations (Golub & Van Loan, sec. 8.5).
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
    """F = U diag(s) V^T with rotations U and V; the smallest s carries the sign of det F."""
    A = F.T @ F
    eigen(A, s, V)
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
