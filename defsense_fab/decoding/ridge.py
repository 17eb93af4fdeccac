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

# What a linear decoder sees of the signals: themselves, or their squares and products as well.
#
# Each feature is a polynomial of second degree, phi_f(s) = a_f . s + s^T H_f s / 2. The second kind
# is still the paper's family of maps (DefSense, CHI 2016, Eqs. 4-8, with more columns).

#: Of signals for decoders that bend: squares and products, kernels; (R - R0)/R0.
LEAST_NOISE = 2e-4


@dataclass(frozen=True)
class Features:
    """`linear` (f, c) and `second` (f, c, c), symmetric, of f features of c signals.

    Signals are taken to be uncertain by `least_noise` at least, however good the read-out is: many
    features of exact signals fit the states that they are trained on and nothing between them.
    """

    name: str
    linear: Float
    second: Float
    least_noise: float

    def __call__(self, signals: Float) -> Float:
        """(..., f) of signals (..., c)."""
        bent = 2 * self.linear + np.einsum("...c,fcd->...fd", signals, self.second)
        return np.asarray(0.5 * np.einsum("...d,...fd->...f", signals, bent))

    def uncertainty(self, noise: Float | float) -> Float:
        """The noise of the signals to count with, as many numbers as `noise`."""
        return np.maximum(noise, self.least_noise)

    def slopes(self, signals: Float) -> Float:
        """Derivatives (..., f, c) by the signals (..., c)."""
        return np.asarray(self.linear + np.einsum("...c,fcd->...fd", signals, self.second))


def affine(channels: int) -> Features:
    """The signals."""
    return Features("affine", np.eye(channels), np.zeros((channels,) * 3), 1e-6)


def quadratic(channels: int) -> Features:
    """The signals, their squares and their products in pairs."""
    i, j = np.triu_indices(channels)
    k = channels + np.arange(len(i))
    count = channels + len(i)
    linear, second = np.zeros((count, channels)), np.zeros((count, channels, channels))
    linear[:channels] = np.eye(channels)
    second[k, i, j] += 1
    second[k, j, i] += 1
    return Features("quadratic", linear, second, LEAST_NOISE)


#: What layouts are designed for, by the decoder that will be used: a kernel decoder sees more than
#: squares and products, but at least those.
KINDS = {"affine": affine, "quadratic": quadratic, "kernel": quadratic}


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
