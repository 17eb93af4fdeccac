"""Least squares of the poses' amplitudes, compiled: a few microseconds for six poses."""

from __future__ import annotations

import numpy as np

from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row, copy_rows

_ROUNDS, _SWEEPS = 12, 60  # of Gauss-Newton; over the unknowns of each of its steps
_CLOSE = 1e-4  # of an amplitude: what moves less is found


@compiled()
def add_poses(a, knots, counts, values, slopes, total, jacobian):  # type: ignore[no-untyped-def]
    """Add displacements of all poses at amplitudes a (p,) to `total` (m, 3), and set `jacobian`
    (p, m, 3), their derivatives."""
    for p in range(len(a)):
        last = counts[p] - 1
        k = 0
        while k < last - 1 and a[p] >= knots[p, k + 1]:
            k += 1
        h = knots[p, k + 1] - knots[p, k]
        t = (a[p] - knots[p, k]) / h
        beyond = t - 1 if t > 1 else 0.0  # straight on
        t = min(t, 1.0)
        v1 = t * t * (3 - 2 * t)
        s0, s1 = h * t * (1 - t) ** 2, h * t * t * (t - 1) + beyond * h
        dv1 = 6 * t * (1 - t) / h
        ds0, ds1 = (1 - t) * (1 - 3 * t), t * (3 * t - 2)
        for m in range(total.shape[0]):
            for x in range(3):
                low, high = values[p, k, m, x], values[p, k + 1, m, x]
                g0, g1 = slopes[p, k, m, x], slopes[p, k + 1, m, x]
                total[m, x] += low + v1 * (high - low) + s0 * g0 + s1 * g1
                jacobian[p, m, x] = dv1 * (high - low) + ds0 * g0 + ds1 * g1


@compiled()
def linearise(  # type: ignore[no-untyped-def]
    a, u, weights, prior, knots, counts, values, slopes, jacobian, H, g
):
    """Weighted sum of squares that the poses at `a` leave of the displacements u (m, 3), and the
    same with the prior; H (p, p) and g (p,) are half its second and the negative of half its first
    derivatives, after Gauss and Newton. `weights` (m,) are 1/mm^2."""
    total = np.zeros_like(u)
    add_poses(a, knots, counts, values, slopes, total, jacobian)
    left = 0.0
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
            left += w * r * r
            for p in range(n):
                wj = w * jacobian[p, m, x]
                g[p] += wj * r
                for q in range(p + 1):
                    H[p, q] += wj * jacobian[q, m, x]
    for p in range(n):
        for q in range(p):
            H[q, p] = H[p, q]
    cost = left
    for p in range(n):
        cost += prior * a[p] * a[p]
    return left, cost


@compiled()
def descend(a, upper, u, weights, prior, knots, counts, values, slopes):  # type: ignore[no-untyped-def]
    """Gauss-Newton from the amplitudes a (p,), which are changed, within 0..upper (p,). Returns the
    sum of squares that is left, the same with the prior, and H (p, p)."""
    n = len(a)
    jacobian = np.empty((n, u.shape[0], 3))
    H, g = np.empty((n, n)), np.empty(n)
    H2, g2 = np.empty((n, n)), np.empty(n)
    d, tried = np.empty(n), np.empty(n)
    for p in range(n):
        a[p] = min(a[p], upper[p])
    left, cost = linearise(a, u, weights, prior, knots, counts, values, slopes, jacobian, H, g)
    for _ in range(_ROUNDS):
        # The step, within the bounds, unknown by unknown (projected Gauss-Seidel).
        d[:] = 0
        for _ in range(_SWEEPS):
            change = 0.0
            for p in range(n):
                slope = g[p]
                for q in range(n):
                    slope -= H[p, q] * d[q]
                step = min(max(d[p] + slope / H[p, p], -a[p]), upper[p] - a[p])
                change = max(change, abs(step - d[p]))
                d[p] = step
            if change < 0.01 * _CLOSE:
                break
        if np.abs(d).max() < _CLOSE:
            break
        size, better = 1.0, False
        for _ in range(6):
            for p in range(n):
                tried[p] = min(max(a[p] + size * d[p], 0.0), upper[p])
            left2, cost2 = linearise(
                tried, u, weights, prior, knots, counts, values, slopes, jacobian, H2, g2
            )
            if cost2 < cost:
                better = True
                break
            size /= 2
        if not better:
            break
        copy_row(tried, a)
        copy_row(g2, g)
        copy_rows(H2, H)
        left, cost = left2, cost2
    return left, cost, H


@compiled()
def _both_active(a, opposites):  # type: ignore[no-untyped-def]
    for p in range(len(a)):
        for q in range(p):
            if opposites[p, q] and a[p] > 0 and a[q] > 0:
                return p, q
    return -1, -1


@compiled()
def fit(  # type: ignore[no-untyped-def]
    a, most, u, weights, prior, opposites, enough, knots, counts, values, slopes
):
    """Amplitudes from the start a (p,), which is changed. Of `opposites` (p, p) only one is active:
    the one that explains more. From rest, too, where from `a` more than `enough` is left."""
    n = len(a)
    upper = np.empty(n)
    upper[:] = most
    left, cost, H = descend(a, upper, u, weights, prior, knots, counts, values, slopes)
    if left > enough:
        other = np.zeros_like(a)
        l2, c2, H2 = descend(other, upper, u, weights, prior, knots, counts, values, slopes)
        if c2 < cost:
            a[:], left, H = other, l2, H2
    for _ in range(n):  # each round, if any, holds one more at 0
        p, q = _both_active(a, opposites)
        if p < 0:
            break
        one, two = a.copy(), a.copy()
        upper[p] = 0
        l1, c1, H1 = descend(one, upper, u, weights, prior, knots, counts, values, slopes)
        upper[p], upper[q] = most, 0
        l2, c2, H2 = descend(two, upper, u, weights, prior, knots, counts, values, slopes)
        if c1 < c2:
            upper[p], upper[q] = 0, most
            a[:], left, H = one, l1, H1
        else:
            a[:], left, H = two, l2, H2
    return left, H
