"""Fit the amplitudes of poses by least squares; compiled, a few microseconds for six poses.

Two tuples are passed on. `ramps` describes the p poses, as `PoseBasis` does: the amplitudes (p, k)
of each pose's states, their number (p,), the displacements (p, k, m, 3), mm, at the states, and
their derivatives (p, k, m, 3), mm per amplitude. `measured` is what is fitted: the displacements
(m, 3), mm, the markers' weights (m,), 1/mm^2, and the inverse variance of the amplitudes.
"""

from __future__ import annotations

import numpy as np

from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row, copy_rows

_MAX_NEWTON_STEPS = 12
_MAX_SWEEPS = 60  # over the unknowns of one step
_AMPLITUDE_TOLERANCE = 1e-4  # of a converged amplitude


@compiled()
def add_poses(a, ramps, total, jacobian):  # type: ignore[no-untyped-def]
    """Add the displacements of all poses at amplitudes `a`, and set their derivatives.

    Args:
        a: Amplitudes (p,).
        ramps: The poses.
        total: Displacements (m, 3), mm, that are added to.
        jacobian: Derivatives (p, m, 3), mm per amplitude, that are set.
    """
    knots, counts, values, slopes = ramps
    for p in range(len(a)):
        last = counts[p] - 1
        k = 0
        while k < last - 1 and a[p] >= knots[p, k + 1]:
            k += 1
        h = knots[p, k + 1] - knots[p, k]
        t = (a[p] - knots[p, k]) / h
        excess = t - 1 if t > 1 else 0.0  # linear extrapolation
        t = min(t, 1.0)
        v1 = t * t * (3 - 2 * t)
        s0, s1 = h * t * (1 - t) ** 2, h * t * t * (t - 1) + excess * h
        dv1 = 6 * t * (1 - t) / h
        ds0, ds1 = (1 - t) * (1 - 3 * t), t * (3 * t - 2)
        for m in range(total.shape[0]):
            for x in range(3):
                low, high = values[p, k, m, x], values[p, k + 1, m, x]
                g0, g1 = slopes[p, k, m, x], slopes[p, k + 1, m, x]
                total[m, x] += low + v1 * (high - low) + s0 * g0 + s1 * g1
                jacobian[p, m, x] = dv1 * (high - low) + ds0 * g0 + ds1 * g1


@compiled()
def linearize(a, ramps, measured, jacobian, H, g):  # type: ignore[no-untyped-def]
    """Compute the weighted sum of squares of the residual, and its Gauss-Newton derivatives.

    Args:
        a: Amplitudes (p,).
        ramps: The poses.
        measured: What is fitted.
        jacobian: Work array (p, m, 3).
        H: Set to half the second derivatives (p, p) of the sum with the prior.
        g: Set to minus half its first derivatives (p,).

    Returns:
        The sum of squares, and the same with the prior.
    """
    u, weights, prior = measured
    total = np.zeros_like(u)
    add_poses(a, ramps, total, jacobian)
    residual = 0.0
    n = len(a)
    for p in range(n):
        g[p] = -prior * a[p]
        for q in range(n):
            H[p, q] = prior if p == q else 0.0
    for m in range(u.shape[0]):
        w = weights[m]
        if w == 0:
            continue
        for x in range(3):
            r = u[m, x] - total[m, x]
            residual += w * r * r
            for p in range(n):
                wj = w * jacobian[p, m, x]
                g[p] += wj * r
                for q in range(p + 1):
                    H[p, q] += wj * jacobian[q, m, x]
    for p in range(n):
        for q in range(p):
            H[q, p] = H[p, q]
    cost = residual
    for p in range(n):
        cost += prior * a[p] * a[p]
    return residual, cost


@compiled()
def descend(a, upper, ramps, measured):  # type: ignore[no-untyped-def]
    """Minimize the sum of squares by Gauss-Newton steps from `a` (p,), which is changed.

    Amplitudes stay within 0 to `upper` (p,).

    Returns:
        The residual sum of squares, the same with the prior, and H (p, p).
    """
    n = len(a)
    jacobian = np.empty((n, measured[0].shape[0], 3))
    H, g = np.empty((n, n)), np.empty(n)
    H2, g2 = np.empty((n, n)), np.empty(n)
    d, trial = np.empty(n), np.empty(n)
    for p in range(n):
        a[p] = min(a[p], upper[p])
    residual, cost = linearize(a, ramps, measured, jacobian, H, g)
    for _ in range(_MAX_NEWTON_STEPS):
        # The step within the bounds, one unknown at a time (projected Gauss-Seidel).
        d[:] = 0
        for _ in range(_MAX_SWEEPS):
            change = 0.0
            for p in range(n):
                slope = g[p]
                for q in range(n):
                    slope -= H[p, q] * d[q]
                step = min(max(d[p] + slope / H[p, p], -a[p]), upper[p] - a[p])
                change = max(change, abs(step - d[p]))
                d[p] = step
            if change < 0.01 * _AMPLITUDE_TOLERANCE:
                break
        if np.abs(d).max() < _AMPLITUDE_TOLERANCE:
            break
        size, is_better = 1.0, False
        for _ in range(6):
            for p in range(n):
                trial[p] = min(max(a[p] + size * d[p], 0.0), upper[p])
            residual2, cost2 = linearize(trial, ramps, measured, jacobian, H2, g2)
            if cost2 < cost:
                is_better = True
                break
            size /= 2
        if not is_better:
            break
        copy_row(trial, a)
        copy_row(g2, g)
        copy_rows(H2, H)
        residual, cost = residual2, cost2
    return residual, cost, H


@compiled()
def _both_active(a, opposites):  # type: ignore[no-untyped-def]
    for p in range(len(a)):
        for q in range(p):
            if opposites[p, q] and a[p] > 0 and a[q] > 0:
                return p, q
    return -1, -1


@compiled()
def fit(a, limit, ramps, measured, opposites, expected):  # type: ignore[no-untyped-def]
    """Fit amplitudes, starting from `a` (p,), which is changed.

    Args:
        a: Start, replaced by the amplitudes.
        limit: Largest amplitude.
        ramps: The poses.
        measured: What is fitted.
        opposites: Pairs of poses (p, p) of which only one may be active: the one that explains
            more.
        expected: Sum of squares of the noise; if more remains, the fit is repeated from rest.

    Returns:
        The residual sum of squares and H (p, p).
    """
    n = len(a)
    upper = np.empty(n)
    upper[:] = limit
    residual, cost, H = descend(a, upper, ramps, measured)
    if residual > expected:
        other = np.zeros_like(a)
        l2, c2, H2 = descend(other, upper, ramps, measured)
        if c2 < cost:
            a[:], residual, H = other, l2, H2
    for _ in range(n):  # each round, if any, fixes one more at 0
        p, q = _both_active(a, opposites)
        if p < 0:
            break
        first, second = a.copy(), a.copy()
        upper[p] = 0
        l1, c1, H1 = descend(first, upper, ramps, measured)
        upper[p], upper[q] = limit, 0
        l2, c2, H2 = descend(second, upper, ramps, measured)
        if c1 < c2:
            upper[p], upper[q] = 0, limit
            a[:], residual, H = first, l1, H1
        else:
            a[:], residual, H = second, l2, H2
    return residual, H
