"""Marker positions as a polynomial of the modes' coordinates: what a fit has to evaluate often."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from ...core.arrays import Float, Int
from .attachment import Attachment
from .rotation_strain import RotationStrain

_CUBIC = 5  # leading modes with terms of third degree
_SPREAD = 1.3  # of the samples, in standard deviations of the states
_SAMPLES = 2.0  # for each term
_SEED = 3


@dataclass(frozen=True)
class MarkerMap:
    """Terms are products of up to three coordinates, `factors` (t, 3), where k stands for 1;
    `values` (t, m, 3) mm."""

    modes: int
    factors: Int
    values: Float

    @classmethod
    def of(cls, basis: RotationStrain, attachment: Attachment) -> MarkerMap:
        """Fitted to surfaces at the states and at random coordinates around them."""
        k = basis.modes
        pairs = combinations_with_replacement(range(k), 2)
        factors = np.array(
            [
                (k, k, k),
                *((i, k, k) for i in range(k)),
                *((i, j, k) for i, j in pairs),
                *combinations_with_replacement(range(min(k, _CUBIC)), 3),
            ]
        )
        count = int(_SAMPLES * len(factors))
        random = _SPREAD * np.random.default_rng(_SEED).standard_normal((count, k))
        samples = np.concatenate([np.zeros((1, k)), basis.coordinates, random])
        markers = np.empty((len(samples), *attachment.offset.shape))
        for s, q in enumerate(samples):
            x, rotations, _ = basis.surface(q, basis.net.rest)
            markers[s] = attachment.on_surface(x) + attachment.stand_off(rotations)
        ones = np.concatenate([samples, np.ones((len(samples), 1))], axis=1)
        terms = ones[:, factors].prod(axis=2)
        flat, *_ = np.linalg.lstsq(terms, markers.reshape(len(samples), -1), rcond=1e-12)
        return cls(k, factors, flat.reshape(len(factors), *markers.shape[1:]))

    def at(self, q: Float) -> tuple[Float, Float]:
        """Markers (m, 3) mm, and their derivatives (m, 3, k), at coordinates q (k,)."""
        a = np.append(q, 1.0)[self.factors]
        slopes = np.zeros((len(self.factors), self.modes + 1))
        rows = np.arange(len(self.factors))
        for j in range(3):
            rest = a[:, (j + 1) % 3] * a[:, (j + 2) % 3]
            np.add.at(slopes, (rows, self.factors[:, j]), rest)
        both = np.concatenate([a.prod(axis=1)[:, None], slopes[:, :-1]], axis=1)
        found = (both.T @ self.values.reshape(len(self.factors), -1)).reshape(
            self.modes + 1, *self.values.shape[1:]
        )
        return found[0], np.moveaxis(found[1:], 0, 2)
