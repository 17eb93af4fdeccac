"""Equations of a few unknowns, solved where a library's call takes longer than its work."""

from __future__ import annotations

import math

from ...core.machine.compiled import compiled


@compiled()
def solve(A, g, L, x):  # type: ignore[no-untyped-def]
    """x of A x = g, A (n, n) symmetric, by Cholesky's factors, for which L has room; whether A is
    positive definite."""
    n = len(g)
    for a in range(n):
        for b in range(a + 1):
            total = A[a, b]
            for c in range(b):
                total -= L[a, c] * L[b, c]
            if a > b:
                L[a, b] = total / L[b, b]
            elif total > 0:
                L[a, a] = math.sqrt(total)
            else:
                return False
        total = g[a]
        for c in range(a):
            total -= L[a, c] * x[c]
        x[a] = total / L[a, a]
    for a in range(n - 1, -1, -1):
        total = x[a]
        for c in range(a + 1, n):
            total -= L[c, a] * x[c]
        x[a] = total / L[a, a]
    return True
