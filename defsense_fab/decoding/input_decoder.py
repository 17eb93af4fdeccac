"""What a trained decoder makes of its inputs: themselves, products of them, and radial basis
functions of the first of them.

With no products and no functions this is DefSense's affine map; with the products of all pairs of
signals, the quadratic one; with functions about a few chosen states, kernel ridge regression on
these (the subset of regressors; Rasmussen & Williams, Gaussian Processes for Machine Learning,
section 8.3.1): a blend of the states that were trained, and far from all of them the rest alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float, Int
from ..core.machine.compiled import compiled

# A map of a device without a past, behind signals from which the cords' past is taken out.
#
# All cords of a device are of one rubber: what they remember, they remember alike. So a few numbers
# that are shared by all channels, with a gain and an offset of each, bring the signals of built cords
# to those of ideal ones, for which a simulation knows the map.


@dataclass(frozen=True)
class SharedMemory:
    """u = (s + sum_k moved_k h_k + sum_k worked_k q_k - offset) / gain goes into the `decoder` of c
    signals; h and q (`past.py`) are the memories of the K and Q time constants of the past that the
    inputs are made with; `moved` (K,), `worked` (Q,), `gain` and `offset` (c,)."""

    gain: Float
    offset: Float
    moved: Float
    worked: Float
    decoder: InputDecoder

    def ideal(self, inputs: Float) -> Float:
        """u (t, c) of inputs (t, c (1 + K + Q))."""
        c = len(self.gain)
        shares = np.concatenate([[1.0], self.moved, self.worked])
        s = np.tensordot(inputs.reshape(*inputs.shape[:-1], len(shares), c), shares, (-2, 0))
        return np.asarray((s - self.offset) / self.gain)

    def __call__(self, inputs: Float) -> Float:
        """(t, o) of inputs (t, d)."""
        return self.decoder(self.ideal(inputs))

    def one(self, inputs: Float) -> Float:
        """(o,) of one sample's inputs (d,)."""
        return self.decoder.one(self.ideal(inputs))


@dataclass(frozen=True)
class InputFeatures:
    """f = d + p + k features of d inputs z: z, then z_i z_j of the `products` (p, 2), then
    exp(-|(z - center) / scale|^2 / 2) of the `centers` (k, e), of the first e inputs, with `scale`
    (e,)."""

    inputs: int
    products: Int
    centers: Float
    scale: Float

    def __post_init__(self) -> None:
        # Of none, a file knows no second dimension.
        object.__setattr__(self, "products", self.products.reshape(-1, 2))
        object.__setattr__(self, "centers", self.centers.reshape(-1, len(self.scale)))

    @property
    def count(self) -> int:
        return self.inputs + len(self.products) + len(self.centers)

    def __call__(self, inputs: Float) -> Float:
        """(t, f) of inputs (t, d)."""
        i, j = self.products.T
        return np.concatenate([inputs, inputs[:, i] * inputs[:, j], self._bumps(inputs)[0]], axis=1)

    def slopes(self, inputs: Float) -> Float:
        """Derivatives (t, f, d) by the inputs (t, d)."""
        t, d = inputs.shape
        out = np.zeros((t, self.count, d))
        out[:, np.arange(d), np.arange(d)] = 1.0
        for row, (i, j) in enumerate(self.products, d):
            out[:, row, i] += inputs[:, j]
            out[:, row, j] += inputs[:, i]
        bumps, apart = self._bumps(inputs)
        out[:, d + len(self.products) :, : len(self.scale)] = -bumps[..., None] * apart / self.scale
        return out

    def roughness(self) -> Float:
        """(f, f): w^T roughness w is the squared norm of the radial functions' sum with weights w
        in their reproducing kernel Hilbert space, by the square of their width. Without it large
        weights that cancel where there are states run wild beyond them."""
        out = np.zeros((self.count, self.count))
        k = len(self.centers)
        if k:
            apart = (self.centers[:, None] - self.centers) / self.scale
            width = float(np.exp(2 * np.log(self.scale).mean()))
            out[-k:, -k:] = np.exp(-0.5 * (apart**2).sum(-1)) / width
        return out

    def _bumps(self, inputs: Float) -> tuple[Float, Float]:
        apart = (inputs[:, None, : len(self.scale)] - self.centers) / self.scale
        return np.exp(-0.5 * (apart**2).sum(-1)), apart


def no_products() -> Int:
    """(0, 2)."""
    return np.zeros((0, 2), np.int64)


def all_products(channels: int) -> Int:
    """Of each pair of the first inputs, squares among them (p, 2)."""
    return np.stack(np.triu_indices(channels), axis=1).astype(np.int64)


@dataclass(frozen=True)
class InputDecoder:
    """outputs = features(inputs) @ weights (f, o) + constant (o,), outputs in mm."""

    features: InputFeatures
    weights: Float
    constant: Float

    def __call__(self, inputs: Float) -> Float:
        """(t, o) of inputs (t, d)."""
        return np.asarray(self.features(inputs) @ self.weights + self.constant)

    def one(self, inputs: Float) -> Float:
        """(o,) of one sample's inputs (d,): compiled, for live use."""
        f = self.features
        return np.asarray(_one(inputs, f.products, f.centers, f.scale, self.weights, self.constant))


@compiled(error_model="numpy")
def _one(z, products, centers, scale, weights, constant):  # type: ignore[no-untyped-def]
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
