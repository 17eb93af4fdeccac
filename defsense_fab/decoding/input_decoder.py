"""Decoders of trained models: features of the inputs, linear weights, and a memory of all channels.

Features are the inputs, products of them, and radial basis functions of the first of them. Without
products and functions this is DefSense's affine map; with the products of all pairs of signals it
is the quadratic one. With functions about some chosen states, memories included, it is kernel ridge
regression on these (the subset of regressors): a blend of the trained states, and far from all of
them the linear part alone.

References:
    Rasmussen & Williams, Gaussian Processes for Machine Learning, section 8.3.1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Bool, Float, Int
from ..core.machine.compiled import compiled

_JITTER = 1e-10  # on the kernel's diagonal, for centers that nearly coincide


@dataclass(frozen=True)
class InputFeatures:
    """f = d + p + k features of d inputs z.

    They are z, then z_i z_j, then exp(-|(z - center) / scale|^2 / 2) of the first e inputs.

    Attributes:
        inputs: Number of inputs d.
        products: Pairs of inputs (p, 2), by index.
        centers: Centers of the radial basis functions (k, e).
        scale: Their scale in each input (e,).
    """

    inputs: int
    products: Int
    centers: Float
    scale: Float

    def __post_init__(self) -> None:
        # A file stores no second dimension for empty arrays.
        object.__setattr__(self, "products", self.products.reshape(-1, 2))
        object.__setattr__(self, "centers", self.centers.reshape(-1, len(self.scale)))

    @property
    def count(self) -> int:
        """Number of features f."""
        return self.inputs + len(self.products) + len(self.centers)

    def __call__(self, inputs: Float) -> Float:
        """Return the features (t, f) of inputs (t, d)."""
        i, j = self.products.T
        return np.concatenate([inputs, inputs[:, i] * inputs[:, j], self._radial(inputs)], axis=1)

    def penalty(self, inputs: Float) -> Float:
        """Return the matrix P (f, f) of which w^T P w is the cost of weights w.

        Of polynomials, it is the mean of J J^T with the slopes J of the features at the inputs, so
        that w^T P w is the variance of the output by noise of the inputs. Next to radial functions
        it is the variance of each polynomial, and w^T P w of the radial functions is the squared
        norm of their weighted sum in its reproducing kernel Hilbert space: without it, large
        weights that cancel at the states oscillate between them.

        Args:
            inputs: Inputs (t, d).
        """
        if not len(self.centers):
            return self._noise_variance(inputs)
        out = np.zeros((self.count, self.count))
        k = len(self.centers)
        i, j = self.products.T
        linear = np.concatenate([inputs, inputs[:, i] * inputs[:, j]], axis=1)
        np.fill_diagonal(out[:-k, :-k], linear.var(axis=0))
        out[-k:, -k:] = self._radial(self.centers)
        out[-k:, -k:] += _JITTER * np.eye(k)
        return out

    def _noise_variance(self, inputs: Float) -> Float:
        """Return the mean of J J^T (f, f) of polynomials, from the moments of inputs (t, d)."""
        d = self.inputs
        out = np.eye(self.count)
        if not len(self.products):
            return out
        mean, second = inputs.mean(axis=0), inputs.T @ inputs / len(inputs)
        unit = np.eye(d)
        i, j = self.products.T
        out[d:, :d] = unit[i] * mean[j][:, None] + unit[j] * mean[i][:, None]
        out[:d, d:] = out[d:, :d].T
        out[d:, d:] = sum(
            (a[:, None] == b) * second[np.ix_(c, e)]
            for a, c in ((i, j), (j, i))
            for b, e in ((i, j), (j, i))
        )
        return out

    def _radial(self, inputs: Float) -> Float:
        """Return the radial functions (t, k)."""
        if not len(self.centers):
            return np.zeros((len(inputs), 0))
        middle = self.centers.mean(axis=0)
        x = (inputs[:, : len(self.scale)] - middle) / self.scale
        c = (self.centers - middle) / self.scale
        square = (x**2).sum(axis=1)[:, None] + (c**2).sum(axis=1) - 2 * (x @ c.T)
        return np.asarray(np.exp(-0.5 * np.maximum(square, 0.0)))


def no_products() -> Int:
    """Return an empty list of products (0, 2)."""
    return np.zeros((0, 2), np.int64)


def all_products(channels: int) -> Int:
    """Return all pairs (p, 2) of the first inputs, squares included."""
    return np.stack(np.triu_indices(channels), axis=1).astype(np.int64)


@dataclass(frozen=True)
class InputDecoder:
    """Map outputs = features(inputs) @ weights + constant.

    Attributes:
        features: Features of the inputs.
        weights: Weights (f, o), mm.
        constant: Constant (o,), mm.
    """

    features: InputFeatures
    weights: Float
    constant: Float

    def __call__(self, inputs: Float) -> Float:
        """Return the outputs (t, o) in mm of inputs (t, d)."""
        return np.asarray(self.features(inputs) @ self.weights + self.constant)

    def select(self, outputs: Bool) -> InputDecoder:
        """Return the decoder of the outputs of a mask (o,)."""
        return replace(self, weights=self.weights[:, outputs], constant=self.constant[outputs])

    def scale(self, factor: Float, offset: Float) -> InputDecoder:
        """Return the decoder whose outputs are `factor` (o,) times these, plus `offset` (o,)."""
        return replace(
            self, weights=self.weights * factor, constant=self.constant * factor + offset
        )

    def decode_sample(self, inputs: Float) -> Float:
        """Return the outputs (o,) in mm of one sample (d,); compiled, for live use."""
        f = self.features
        return np.asarray(
            _decode_sample(inputs, f.products, f.centers, f.scale, self.weights, self.constant)
        )


@compiled(error_model="numpy")
def _decode_sample(z, products, centers, scale, weights, constant):  # type: ignore[no-untyped-def]
    d, p = len(z), len(products)
    out = constant.copy()
    for f in range(len(weights)):
        if f < d:
            x = z[f]
        elif f < d + p:
            x = z[products[f - d, 0]] * z[products[f - d, 1]]
        else:
            square = 0.0
            for e in range(len(scale)):
                square += ((z[e] - centers[f - d - p, e]) / scale[e]) ** 2
            x = np.exp(-0.5 * square)
        for o in range(len(out)):
            out[o] += x * weights[f, o]
    return out


@dataclass(frozen=True)
class SharedMemory:
    """A simulated map without memory, behind signals from which the cords' memory is removed.

    All cords of a device are made of the same rubber, so their memories have the same form. A few
    numbers that all channels share, with a gain and an offset of each channel, convert the signals
    of built cords to those of ideal ones, whose map a simulation gives. The ideal signals are
    u = (s + sum_k moved_k h_k + sum_k worked_k q_k - offset) / gain, with the memories h and q of
    `signal_history.py` for its K and Q time constants.

    Attributes:
        gain: Gain of each channel (c,).
        offset: Offset of each channel (c,).
        moved: Weights (K,) of the memories h.
        worked: Weights (Q,) of the memories q.
        decoder: Map from ideal signals (c,) to outputs.
    """

    gain: Float
    offset: Float
    moved: Float
    worked: Float
    decoder: InputDecoder

    def ideal_signals(self, inputs: Float) -> Float:
        """Return the ideal signals (t, c) of inputs (t, c (1 + K + Q))."""
        c = len(self.gain)
        shares = np.concatenate([[1.0], self.moved, self.worked])
        s = np.tensordot(inputs.reshape(*inputs.shape[:-1], len(shares), c), shares, (-2, 0))
        return np.asarray((s - self.offset) / self.gain)

    def __call__(self, inputs: Float) -> Float:
        """Return the outputs (t, o) in mm of inputs (t, d)."""
        return self.decoder(self.ideal_signals(inputs))

    def decode_sample(self, inputs: Float) -> Float:
        """Return the outputs (o,) in mm of one sample (d,)."""
        return self.decoder.decode_sample(self.ideal_signals(inputs))
