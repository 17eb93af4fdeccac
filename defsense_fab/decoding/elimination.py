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
from ..core.machine import kernels
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
    outputs, explained = np.ascontiguousarray(outputs), np.empty(len(sets))
    kernels.explained_squares(sets, features.linear, features.hessian, outputs, variance, explained)
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
    signals, outputs = np.ascontiguousarray(signals), np.ascontiguousarray(outputs)
    square, out = np.empty(1), np.empty(signals.shape)
    kernels.square_gradient(
        signals, features.linear, features.hessian, outputs, variance, square, out
    )
    return float(square[0]), out
