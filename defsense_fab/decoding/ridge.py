"""The one place that fits readings to positions: ridge regression with a free constant.

DefSense Eqs. 4-8 on the features of `features.py`. With independent noise of standard deviations
sigma on the signals, the expected squared error of a map beta is, to second order in sigma,
|Phi beta - O|^2 + tr(beta^T W beta) with W = sum_n J_n diag(sigma^2) J_n^T, J_n the slopes of the
features at state n. For an affine map that is exact and W = N diag(sigma^2): the noise gives the
weight of the ridge, and the optimum is the expected error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Float
from .features import Features


@dataclass(frozen=True)
class Decoder:
    """outputs = features(signals) @ weights (f, o) + constant (o,), outputs in mm."""

    features: Features
    weights: Float
    constant: Float

    def __call__(self, signals: Float) -> Float:
        """(n, o) of signals (n, c)."""
        return np.asarray(self.features(signals) @ self.weights + self.constant)

    def to_json(self) -> dict[str, Any]:
        """Its numbers, for `prediction.json`."""
        return {"weights": self.weights.tolist(), "constant": self.constant.tolist()}

    def noise_variance(self, signals: Float, noise: Float | float) -> Float:
        """Variance (n, o) mm^2 that noise (c,) on the signals (n, c) puts on each output."""
        return noise_on_outputs(self.features.slopes(signals), self.weights, noise)


def noise_on_outputs(slopes: Float, weights: Float, noise: Float | float) -> Float:
    """Variance (n, o) that noise (c,) of the signals puts on outputs which are features times
    `weights` (f, o), to first order, from the features' slopes (n, f, c)."""
    change = np.einsum("nfc,fo->nco", slopes, weights)
    variance = np.broadcast_to(np.square(noise), slopes.shape[2:])
    return np.asarray(np.einsum("c,nco->no", variance, change**2))


def noise_weight(features: Features, signals: Float, noise: Float | float) -> Float:
    """W (..., f, f) of signals (..., n, c) with noise (c,)."""
    slopes = features.slopes(signals)
    uncertain = slopes * features.uncertainty(noise)
    return np.asarray(np.einsum("...nfc,...ngc->...fg", uncertain, uncertain))


def fit(features: Features, signals: Float, outputs: Float, noise: Float | float) -> Decoder:
    """The map with the least expected error: signals (n, c) with noise (c,), outputs (n, o)."""
    phi = features(signals)
    p_mean, o_mean = phi.mean(0), outputs.mean(0)
    p, o = phi - p_mean, outputs - o_mean
    beta = np.linalg.solve(regular(p.T @ p + noise_weight(features, signals, noise)), p.T @ o)
    return Decoder(features, beta, o_mean - p_mean @ beta)


def regular(normal: Float) -> Float:
    """Normal matrices (..., f, f) with just enough added for features that repeat each other or are
    all zero, as many features of few states are."""
    size = np.diagonal(normal, axis1=-2, axis2=-1)
    added = 1e-14 * size + 1e-20 * size.max(axis=-1, keepdims=True, initial=1e-300)
    return np.asarray(normal + added[..., None] * np.eye(size.shape[-1]))


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
