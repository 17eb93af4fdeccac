"""The models of a response, as least squares sees them: linear in their coefficients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..core.response import MODELS, ResponseSpec
from ..sensing.response import response_of

#: From the simplest to the one that follows anything.
ORDER = ("line", "quadratic", "two-slopes", "cubic", "piecewise")
_SIZES = {"line": 1, "two-slopes": 2, "quadratic": 2, "cubic": 3}
_KNOTS = 3  # of the piecewise model, on either side of rest
_APART = 1e-4  # strain between two knots


@dataclass(frozen=True)
class Model:
    """w(eps) = design(eps) @ theta. The piecewise model's theta are the rises between its `knots`
    (k,), strains with 0 among them, and must not be negative (`rising`)."""

    name: str
    knots: Float

    @property
    def rising(self) -> bool:
        return self.name == "piecewise"

    @property
    def size(self) -> int:
        """How many coefficients it has."""
        return _SIZES.get(self.name, len(self.knots) - 1)

    def design(self, strain: Float) -> Float:
        """(n, size) for strains (n,)."""
        e = np.asarray(strain, float)
        if self.name == "two-slopes":
            return np.stack([np.maximum(e, 0), np.minimum(e, 0)], axis=1)
        if not self.rising:
            return np.stack([e**power for power in range(1, self.size + 1)], axis=1)
        low, high = self.knots[:-1], self.knots[1:]
        climbed = np.clip((e[:, None] - low) / (high - low), 0, 1)
        return np.asarray(climbed - np.clip(-low / (high - low), 0, 1))

    def spec(self, theta: Float, strain_range: tuple[float, float]) -> ResponseSpec:
        """The record with these coefficients."""
        if self.name == "piecewise":
            changes = np.concatenate([[0.0], np.cumsum(theta)])
            rest = int(np.flatnonzero(self.knots == 0)[0])
            values: dict[str, object] = {
                "strains": self.knots.tolist(),
                "changes": (changes - changes[rest]).tolist(),
            }
        else:
            values = dict(zip(MODELS[self.name], map(float, theta), strict=True))
        return ResponseSpec(self.name, values, strain_range)

    def predict(self, theta: Float, strain: Float) -> Float:
        """w at strains (n,): of the piecewise model the smooth curve through its knots, which is
        what will be used."""
        if not self.rising:
            return self.design(strain) @ theta
        ends = float(self.knots[0]), float(self.knots[-1])
        return np.asarray(response_of(self.spec(theta, ends))(strain))

    def slope_at_rest(self, theta: Float) -> float:
        """dw/deps at no strain; of two slopes the mean."""
        if self.name == "two-slopes":
            return float(theta.mean())
        if self.name == "piecewise":
            low, high = float(self.knots[0]), float(self.knots[-1])
            return float(response_of(self.spec(theta, (low, high))).slope(np.array(0.0)))
        return float(theta[0])


def model(name: str, strain: Float) -> Model:
    """The model for data at strains (n,)."""
    return Model(name, _knots(strain) if name == "piecewise" else np.zeros(0))


def _knots(strain: Float) -> Float:
    """Rest, and on either side of it equal shares of the strains that were measured there."""
    shares = np.linspace(0, 1, _KNOTS + 1)
    out = [np.zeros(1)]
    for side, inner in (
        (strain[strain < -_APART], shares[:-1]),
        (strain[strain > _APART], shares[1:]),
    ):
        if len(side):
            out.append(np.quantile(np.unique(side), inner))
    knots = np.sort(np.concatenate(out))
    return np.asarray(knots[np.append(True, np.diff(knots) > _APART)])
