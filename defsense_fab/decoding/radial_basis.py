"""A decoder that bends as it must: radial basis functions about chosen inputs, beside the inputs
themselves, with ridge weights.

What is between training states is a blend of theirs, and far from all of them the linear part
alone. For thousands of frames this is kernel ridge regression on a few chosen centres (the subset
of regressors; Rasmussen & Williams, Gaussian Processes for Machine Learning, section 8.3.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float


@dataclass(frozen=True)
class RadialBasis:
    """f = d + k features of inputs (..., d): the inputs, and exp(-|(z - center) / scale|^2 / 2) of
    the `centers` (k, d), `scale` (d,) in the inputs' units, infinite for those that do not
    count."""

    centers: Float
    scale: Float

    def __call__(self, inputs: Float) -> Float:
        """(..., d + k)."""
        return np.concatenate([inputs, self._bumps(inputs)[0]], axis=-1)

    def slopes(self, inputs: Float) -> Float:
        """Derivatives (..., d + k, d) by the inputs."""
        bumps, apart = self._bumps(inputs)
        bent = -bumps[..., None] * apart / self.scale
        d = inputs.shape[-1]
        straight = np.broadcast_to(np.eye(d), (*inputs.shape[:-1], d, d))
        return np.concatenate([straight, bent], axis=-2)

    def _bumps(self, inputs: Float) -> tuple[Float, Float]:
        apart = (inputs[..., None, :] - self.centers) / self.scale
        return np.exp(-0.5 * (apart**2).sum(-1)), apart


@dataclass(frozen=True)
class RadialDecoder:
    """outputs = basis(inputs) @ weights (f, o) + constant (o,), outputs in mm."""

    features: RadialBasis
    weights: Float
    constant: Float

    def __call__(self, inputs: Float) -> Float:
        """(n, o) of inputs (n, d)."""
        return np.asarray(self.features(inputs) @ self.weights + self.constant)
