"""Ridge regression from features of signals to positions, with a free constant.

Features are the signals themselves, or also their squares and products: polynomials of second
degree, phi_f(s) = a_f . s + s^T H_f s / 2. Both belong to the paper's family of maps (DefSense, CHI
2016, Eqs. 4-8, with more columns).

With independent noise of standard deviations sigma on the signals, the expected squared error of a
map beta is, to second order in sigma, |Phi beta - O|^2 + tr(beta^T W beta) with
W = sum_n J_n diag(sigma^2) J_n^T, where J_n are the slopes of the features at state n. For an
affine map that is exact and W = N diag(sigma^2): the noise determines the ridge's weight, and the
optimum is the expected error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Float

#: Smallest noise that nonlinear decoders assume, (R - R0)/R0.
MIN_NOISE = 2e-4
_MIN_AFFINE_NOISE = 1e-6


@dataclass(frozen=True)
class Features:
    """Polynomial features of second degree, f features of c signals.

    Signals are assumed to be uncertain by at least `min_noise`, however good the read-out is: many
    features of exact signals fit the training states and nothing between them.

    Attributes:
        name: Name of the features.
        linear: Linear coefficients (f, c).
        hessian: Symmetric second derivatives (f, c, c).
        min_noise: Smallest assumed noise of the signals, (R - R0)/R0.
    """

    name: str
    linear: Float
    hessian: Float
    min_noise: float

    def __call__(self, signals: Float) -> Float:
        """Return the features (..., f) of signals (..., c)."""
        factors = 2 * self.linear + np.einsum("...c,fcd->...fd", signals, self.hessian)
        return np.asarray(0.5 * np.einsum("...d,...fd->...f", signals, factors))

    def uncertainty(self, noise: Float | float) -> Float:
        """Return the assumed noise of the signals, in the shape of `noise`."""
        return np.maximum(noise, self.min_noise)

    def slopes(self, signals: Float) -> Float:
        """Return the derivatives (..., f, c) by the signals (..., c)."""
        return np.asarray(self.linear + np.einsum("...c,fcd->...fd", signals, self.hessian))


def affine_features(channels: int) -> Features:
    """Return the signals themselves as features."""
    return Features("affine", np.eye(channels), np.zeros((channels,) * 3), _MIN_AFFINE_NOISE)


def quadratic_features(channels: int) -> Features:
    """Return the signals, their squares and their products in pairs as features."""
    i, j = np.triu_indices(channels)
    k = channels + np.arange(len(i))
    count = channels + len(i)
    linear, hessian = np.zeros((count, channels)), np.zeros((count, channels, channels))
    linear[:channels] = np.eye(channels)
    hessian[k, i, j] += 1
    hessian[k, j, i] += 1
    return Features("quadratic", linear, hessian, MIN_NOISE)


#: Features that layouts are designed for, by the kind of decoder. A kernel decoder uses more than
#: squares and products, but at least those.
FEATURES = {
    "affine": affine_features,
    "quadratic": quadratic_features,
    "kernel": quadratic_features,
}


@dataclass(frozen=True)
class Decoder:
    """Map outputs = features(signals) @ weights + constant.

    Attributes:
        features: Features of the signals.
        weights: Weights (f, o), mm.
        constant: Constant (o,), mm.
    """

    features: Features
    weights: Float
    constant: Float

    def __call__(self, signals: Float) -> Float:
        """Return the outputs (n, o) in mm of signals (n, c)."""
        return np.asarray(self.features(signals) @ self.weights + self.constant)

    def to_json(self) -> dict[str, Any]:
        """Return the numbers for `prediction.json`."""
        return {"weights": self.weights.tolist(), "constant": self.constant.tolist()}

    def noise_variance(self, signals: Float, noise: Float | float) -> Float:
        """Return the variance (n, o) in mm^2 of the outputs for noise (c,) on signals (n, c)."""
        return noise_on_outputs(self.features.slopes(signals), self.weights, noise)


def noise_on_outputs(slopes: Float, weights: Float, noise: Float | float) -> Float:
    """Return the variance that noise of the signals causes in outputs, to first order.

    Args:
        slopes: Derivatives of the features by the signals (n, f, c).
        weights: Weights of the features (f, o).
        noise: Standard deviations of the signals (c,), or one for all.

    Returns:
        Variances (n, o).
    """
    change = np.einsum("nfc,fo->nco", slopes, weights)
    variance = np.broadcast_to(np.square(noise), slopes.shape[2:])
    return np.asarray(np.einsum("c,nco->no", variance, change**2))


def noise_weight(features: Features, signals: Float, noise: Float | float) -> Float:
    """Return W (..., f, f) for signals (..., n, c) with noise (c,); see the module's text."""
    slopes = features.slopes(signals)
    uncertain = slopes * features.uncertainty(noise)
    return np.asarray(np.einsum("...nfc,...ngc->...fg", uncertain, uncertain))


def fit_ridge(features: Features, signals: Float, outputs: Float, noise: Float | float) -> Decoder:
    """Fit the map with the lowest expected error.

    Args:
        features: Features of the signals.
        signals: Signals (n, c), (R - R0)/R0.
        outputs: Outputs (n, o), mm.
        noise: Standard deviations of the signals (c,), or one for all.

    Returns:
        The decoder.
    """
    phi = features(signals)
    p_mean, o_mean = phi.mean(0), outputs.mean(0)
    p, o = phi - p_mean, outputs - o_mean
    beta = np.linalg.solve(regularize(p.T @ p + noise_weight(features, signals, noise)), p.T @ o)
    return Decoder(features, beta, o_mean - p_mean @ beta)


def regularize(normal: Float) -> Float:
    """Return normal matrices (..., f, f) with a small multiple of the identity added.

    It is just enough for features that repeat each other or are all zero, as many features of few
    states are.
    """
    size = np.diagonal(normal, axis1=-2, axis2=-1)
    added = 1e-14 * size + 1e-20 * size.max(axis=-1, keepdims=True, initial=1e-300)
    return np.asarray(normal + added[..., None] * np.eye(size.shape[-1]))
