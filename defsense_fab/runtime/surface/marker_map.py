"""Marker positions as a polynomial of the modes' coordinates: what a fit has to evaluate often."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from ...core.arrays import Float, Int
from .attachment import Attachment
from .rotation_strain import RotationStrain

_LEADING = 3  # modes with terms up to the fifth degree
_MEETING = 4  # modes of which two may meet any other in a term of the third
_RANGE = 1.2  # of the largest coordinate that a state has: how far samples go
_SAMPLES = 2.0  # for each term
_SEED = 3


@dataclass(frozen=True)
class MarkerMap:
    """Terms are products of up to five coordinates, `factors` (t, 5), where k stands for 1;
    `values` (t, m, 3) mm. It is good for coordinates up to `limits` (k,), either way."""

    modes: int
    limits: Float
    factors: Int
    values: Float

    @classmethod
    def of(cls, basis: RotationStrain, attachment: Attachment) -> MarkerMap:
        """Fitted to surfaces at the states and at random coordinates around them."""
        k = basis.modes
        factors = _terms(k)
        limits = _RANGE * np.abs(basis.coordinates).max(axis=0)
        random = np.random.default_rng(_SEED).uniform(
            -1.0, 1.0, (int(_SAMPLES * len(factors)), k)
        )  # fmt: skip
        samples = np.concatenate([np.zeros((1, k)), basis.coordinates, limits * random])
        markers = np.empty((len(samples), *attachment.offset.shape))
        for s, q in enumerate(samples):
            x, rotations, _ = basis.surface(q, basis.net.rest)
            markers[s] = attachment.on_surface(x) + attachment.stand_off(rotations)
        ones = np.concatenate([samples, np.ones((len(samples), 1))], axis=1)
        terms = ones[:, factors].prod(axis=2)
        flat, *_ = np.linalg.lstsq(terms, markers.reshape(len(samples), -1), rcond=1e-12)
        return cls(k, limits, factors, flat.reshape(len(factors), *markers.shape[1:]))

    def at(self, q: Float) -> tuple[Float, Float]:
        """Markers (m, 3) mm, and their derivatives (m, 3, k), at coordinates q (k,)."""
        a = np.append(q, 1.0)[self.factors]
        width = a.shape[1]
        before, after = np.ones((len(a), width + 1)), np.ones((len(a), width + 1))
        before[:, 1:] = np.cumprod(a, axis=1)
        after[:, :-1] = np.cumprod(a[:, ::-1], axis=1)[:, ::-1]
        slopes = np.zeros((len(a), self.modes + 1))
        rows = np.arange(len(a))
        for j in range(width):
            slopes[rows, self.factors[:, j]] += before[:, j] * after[:, j + 1]
        both = np.concatenate([before[:, -1:], slopes[:, :-1]], axis=1)
        found = (both.T @ self.values.reshape(len(self.factors), -1)).reshape(
            self.modes + 1, *self.values.shape[1:]
        )
        return found[0], np.moveaxis(found[1:], 0, 2)


def _terms(k: int) -> Int:
    """(t, 5) coordinates that are multiplied, in rising order, each product once."""
    few = range(min(k, _LEADING))
    found = {
        (),
        *((i,) for i in range(k)),
        *combinations_with_replacement(range(k), 2),
        *(
            tuple(sorted((*pair, i)))
            for pair in combinations_with_replacement(range(min(k, _MEETING)), 2)
            for i in range(k)
        ),
        *combinations_with_replacement(few, 4),
        *combinations_with_replacement(few, 5),
    }
    return np.array([(*term, *(k,) * (5 - len(term))) for term in sorted(found)])
