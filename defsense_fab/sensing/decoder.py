"""The one place that fits readings to positions: ridge regression with a free constant.

DefSense Eqs. 4-8. With independent noise of standard deviation sigma on every signal the
expected squared error of a map beta is |S beta - O|^2 + N sigma^2 |beta|^2, so the ridge
weight lambda^2 = N sigma^2 is given by the noise and the optimum is the expected error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float


@dataclass(frozen=True)
class AffineDecoder:
    """outputs = signals @ weights (c, o) + constant (o,), outputs in mm."""

    weights: Float
    constant: Float

    def __call__(self, signals: Float) -> Float:
        return np.asarray(signals @ self.weights + self.constant)


def ridge_weight(states: int, noise: float) -> float:
    """lambda^2 = N sigma^2; a tiny floor keeps the normal matrix regular without noise."""
    return states * max(noise, 1e-9) ** 2


def fit_affine(signals: Float, outputs: Float, weight: float) -> AffineDecoder:
    """Ridge with an unpenalised constant: signals (n, c), outputs (n, o), weight = lambda^2."""
    s_mean, o_mean = signals.mean(0), outputs.mean(0)
    s, o = signals - s_mean, outputs - o_mean
    beta = np.linalg.solve(s.T @ s + weight * np.eye(s.shape[1]), s.T @ o)
    return AffineDecoder(beta, o_mean - s_mean @ beta)


@dataclass(frozen=True)
class ErrorMeasures:
    """Marker errors in mm over states: root mean square, largest, and mean of the largest."""

    rmse: float
    peak: float
    average_peak: float
    per_state: Float


def measure(predicted: Float, truth: Float, weights: Float) -> ErrorMeasures:
    """Errors of marker positions (n, k, 3) mm; `weights` (k,) of the markers sum to one."""
    distance = np.linalg.norm(predicted - truth, axis=2)
    per_state = np.sqrt((distance**2 * weights).sum(1))
    return ErrorMeasures(
        rmse=float(np.sqrt((per_state**2).mean())),
        peak=float(distance.max()),
        average_peak=float(distance.max(1).mean()),
        per_state=per_state,
    )


def floor(outputs: Float, sensors: int) -> float:
    """Least RMSE (mm) of any affine map from `sensors` signals without noise.

    The rank-M truncation of the centred outputs (n, o), o scaled so that a row's squared norm
    is the state's mean squared marker error (Eckart & Young 1936).
    """
    values = np.linalg.svd(outputs - outputs.mean(0), compute_uv=False)
    return float(np.sqrt((values[sensors:] ** 2).sum() / len(outputs)))
