"""Expected error of the best map, with the map eliminated.

It is computed for very many sets of signals, or with its derivative for one. See `ridge.py` for the
error that is minimized.

References:
    Golub & Pereyra 1973 (variable projection): at the optimal map, the derivative of the expected
    error by a feature is that of the error with a fixed map.
"""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float
from ..core.machine.compiled import compiled
from .ridge import Features


def expected_square(features: Features, signals: Float, outputs: Float, noise: float) -> Float:
    """Return the expected squared error of the best map for many sets of signals.

    Args:
        features: Features of the signals.
        signals: Sets of signals (..., n, c).
        outputs: Centered outputs (n, r), mm.
        noise: Standard deviation of the signals.

    Returns:
        Squared errors (...), summed over states, mm^2.
    """
    sets = np.ascontiguousarray(signals, float).reshape(-1, *signals.shape[-2:])
    variance = features.uncertainty(noise) ** 2
    explained = _explained_squares(sets, features.linear, features.hessian, outputs, variance)
    return np.asarray((outputs**2).sum() - explained.reshape(signals.shape[:-2]))


def expected_square_gradient(
    features: Features, signals: Float, outputs: Float, noise: float
) -> tuple[float, Float]:
    """Return the expected squared error for one set of signals, and its derivative.

    Args:
        features: Features of the signals.
        signals: Signals (n, c).
        outputs: Centered outputs (n, r), mm.
        noise: Standard deviation of the signals.

    Returns:
        The squared error in mm^2, and its derivative (n, c) by the signals.
    """
    variance = features.uncertainty(noise) ** 2
    return _square_gradient(signals, features.linear, features.hessian, outputs, variance)  # type: ignore[no-any-return]


@compiled(error_model="numpy")
def _explained_squares(sets, linear, hessian, outputs, variance):  # type: ignore[no-untyped-def]
    """Return the squares of the outputs that the best map explains, for sets (k, n, c)."""
    count, n, c = sets.shape
    f = len(linear)
    out = np.empty(count)
    phi, slopes = np.empty((n, f)), np.empty((n, f, c))
    factor, right = np.empty((f, f)), np.empty((f, outputs.shape[1]))
    for k in range(count):
        out[k] = _fit(sets[k], linear, hessian, outputs, variance, phi, slopes, factor, right)
    return out


@compiled(error_model="numpy")
def _square_gradient(signals, linear, hessian, outputs, variance):  # type: ignore[no-untyped-def]
    n, c = signals.shape
    f, r = len(linear), outputs.shape[1]
    phi, slopes = np.empty((n, f)), np.empty((n, f, c))
    factor, beta = np.empty((f, f)), np.empty((f, r))
    square = -_fit(signals, linear, hessian, outputs, variance, phi, slopes, factor, beta)
    for o in range(r):
        for a in range(f - 1, -1, -1):
            for d in range(a + 1, f):
                beta[a, o] -= factor[d, a] * beta[d, o]
            beta[a, o] /= factor[a, a]
    by_slope = np.zeros((f, f))
    for a in range(f):
        for b in range(f):
            for o in range(r):
                by_slope[a, b] += variance * beta[a, o] * beta[b, o]
    is_nonlinear = np.any(hessian != 0.0)
    out, by_phi = np.zeros((n, c)), np.empty(f)
    for i in range(n):
        by_phi[:] = 0.0
        for o in range(r):
            residual = -outputs[i, o]
            for a in range(f):
                residual += phi[i, a] * beta[a, o]
            # Residuals sum to zero over the states, so the centering of phi has no effect.
            for a in range(f):
                by_phi[a] += residual * beta[a, o]
            square += outputs[i, o] ** 2
        for a in range(f):
            for d in range(c):
                out[i, d] += 2 * by_phi[a] * slopes[i, a, d]
        if is_nonlinear:
            for a in range(f):
                for d in range(c):
                    w = 0.0
                    for b in range(f):
                        w += by_slope[a, b] * slopes[i, b, d]
                    for e in range(c):
                        out[i, e] += 2 * w * hessian[a, d, e]
    return square, out


@compiled(error_model="numpy")
def _fit(  # type: ignore[no-untyped-def]
    signals, linear, hessian, outputs, variance, phi, slopes, factor, right
):
    """Return the squares of the outputs (n, r) that the best map of the signals (n, c) explains.

    Fills the centered features `phi` (n, f), their `slopes` (n, f, c), the lower Cholesky `factor`
    (f, f) of the normal matrix, and `right` (f, r), the right side phi^T outputs divided by it.
    """
    n, c = signals.shape
    f, r = len(linear), outputs.shape[1]
    is_nonlinear = np.any(hessian != 0.0)
    factor[:] = 0.0
    right[:] = 0.0
    for i in range(n):
        for a in range(f):
            phi[i, a] = 0.0
            for d in range(c):
                slope = linear[a, d]
                if is_nonlinear:
                    for e in range(c):
                        slope += hessian[a, d, e] * signals[i, e]
                slopes[i, a, d] = slope
                phi[i, a] += 0.5 * signals[i, d] * (linear[a, d] + slope)
        for a in range(f):
            for b in range(a + 1):
                for d in range(c):
                    factor[a, b] += variance * slopes[i, a, d] * slopes[i, b, d]
    for a in range(f):
        mean = 0.0
        for i in range(n):
            mean += phi[i, a] / n
        for i in range(n):
            phi[i, a] -= mean
    for i in range(n):
        for a in range(f):
            x = phi[i, a]
            for b in range(a + 1):
                factor[a, b] += x * phi[i, b]
            for o in range(r):
                right[a, o] += x * outputs[i, o]
    explained = 0.0
    for a in range(f):
        size = factor[a, a]
        for b in range(a):
            for d in range(b):
                factor[a, b] -= factor[a, d] * factor[b, d]
            factor[a, b] /= factor[b, b]
        for d in range(a):
            factor[a, a] -= factor[a, d] ** 2
        # The remainder of a feature that repeats the others is rounding: it explains nothing.
        factor[a, a] = np.sqrt(factor[a, a]) if factor[a, a] > 1e-13 * size else 1e150
        for o in range(r):
            for d in range(a):
                right[a, o] -= factor[a, d] * right[d, o]
            right[a, o] /= factor[a, a]
            explained += right[a, o] ** 2
    return explained
