"""Expected error of the best map, with the map eliminated: for very many sets of signals, and with
its derivative for one. `ridge.py` says what is minimised.

Variable projection (Golub & Pereyra 1973): at the optimal map the derivative of the expected error
by a feature is that of the error with the map held.
"""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float
from ..core.machine.compiled import compiled
from .ridge import Features


def expected_square(features: Features, signals: Float, outputs: Float, noise: float) -> Float:
    """Expected squared error, mm^2, summed over states, of the best map for each of many sets of
    signals (..., n, c); `outputs` (n, r) mm are centred."""
    sets = np.ascontiguousarray(signals, float).reshape(-1, *signals.shape[-2:])
    variance = features.uncertainty(noise) ** 2
    explained = _explained(sets, features.linear, features.second, outputs, variance)
    return np.asarray((outputs**2).sum() - explained.reshape(signals.shape[:-2]))


def square_slopes(
    features: Features, signals: Float, outputs: Float, noise: float
) -> tuple[float, Float]:
    """The same for one set of signals (n, c), and the derivative (n, c)."""
    variance = features.uncertainty(noise) ** 2
    return _square_slopes(signals, features.linear, features.second, outputs, variance)  # type: ignore[no-any-return]


@compiled(error_model="numpy")
def _explained(sets, linear, second, outputs, variance):  # type: ignore[no-untyped-def]
    """Squares of the outputs that the best map explains, for each set of signals (k, n, c)."""
    count, n, c = sets.shape
    f = len(linear)
    out = np.empty(count)
    phi, slopes = np.empty((n, f)), np.empty((n, f, c))
    factor, told = np.empty((f, f)), np.empty((f, outputs.shape[1]))
    for k in range(count):
        out[k] = _fit(sets[k], linear, second, outputs, variance, phi, slopes, factor, told)
    return out


@compiled(error_model="numpy")
def _square_slopes(signals, linear, second, outputs, variance):  # type: ignore[no-untyped-def]
    n, c = signals.shape
    f, r = len(linear), outputs.shape[1]
    phi, slopes = np.empty((n, f)), np.empty((n, f, c))
    factor, beta = np.empty((f, f)), np.empty((f, r))
    square = -_fit(signals, linear, second, outputs, variance, phi, slopes, factor, beta)
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
    bent = np.any(second != 0.0)
    out, by_phi = np.zeros((n, c)), np.empty(f)
    for i in range(n):
        by_phi[:] = 0.0
        for o in range(r):
            residual = -outputs[i, o]
            for a in range(f):
                residual += phi[i, a] * beta[a, o]
            # Residuals sum to zero over the states: that phi is centred drops out.
            for a in range(f):
                by_phi[a] += residual * beta[a, o]
            square += outputs[i, o] ** 2
        for a in range(f):
            for d in range(c):
                out[i, d] += 2 * by_phi[a] * slopes[i, a, d]
        if bent:
            for a in range(f):
                for d in range(c):
                    w = 0.0
                    for b in range(f):
                        w += by_slope[a, b] * slopes[i, b, d]
                    for e in range(c):
                        out[i, e] += 2 * w * second[a, d, e]
    return square, out


@compiled(error_model="numpy")
def _fit(  # type: ignore[no-untyped-def]
    signals, linear, second, outputs, variance, phi, slopes, factor, told
):
    """Squares of the outputs (n, r) that the best map of the signals (n, c) explains. Fills the
    centred features `phi` (n, f), their `slopes` (n, f, c), Cholesky's lower `factor` (f, f) of the
    normal matrix, and `told` (f, r): what the features have of the outputs, divided by the factor.
    """
    n, c = signals.shape
    f, r = len(linear), outputs.shape[1]
    bent = np.any(second != 0.0)
    factor[:] = 0.0
    told[:] = 0.0
    for i in range(n):
        for a in range(f):
            phi[i, a] = 0.0
            for d in range(c):
                slope = linear[a, d]
                if bent:
                    for e in range(c):
                        slope += second[a, d, e] * signals[i, e]
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
                told[a, o] += x * outputs[i, o]
    explained = 0.0
    for a in range(f):
        size = factor[a, a]
        for b in range(a):
            for d in range(b):
                factor[a, b] -= factor[a, d] * factor[b, d]
            factor[a, b] /= factor[b, b]
        for d in range(a):
            factor[a, a] -= factor[a, d] ** 2
        # What is left of a feature that the others repeat is rounding: it explains nothing.
        factor[a, a] = np.sqrt(factor[a, a]) if factor[a, a] > 1e-13 * size else 1e150
        for o in range(r):
            for d in range(a):
                told[a, o] -= factor[a, d] * told[d, o]
            told[a, o] /= factor[a, a]
            explained += told[a, o] ** 2
    return explained
