"""What a linear decoder sees of the signals: themselves, or their squares and products as well.

Each feature is a polynomial of second degree, phi_f(s) = a_f . s + s^T H_f s / 2. The second kind
is still the paper's family of maps (DefSense, CHI 2016, Eqs. 4-8, with more columns).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float

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
