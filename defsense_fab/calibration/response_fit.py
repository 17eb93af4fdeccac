"""Fitting one model to the readings of all pieces of cord.

A reading of piece p is y = (R - R0)/R0 = c_p + g_p w(eps) + noise. Its flat reading is a reading
like others, so c_p, the error of R0, is fitted. Pieces differ: g_p, one on average, is drawn
towards one as a normal variable of a known standard deviation (a ridge), which keeps it apart from
a true difference between tension and compression where pieces only saw one of them. Outliers count
less (Huber 1964).

Where it is known what strains a piece came from, more terms take what it remembers of them. Without
these the least bent jig, which is always reached from above, and the most bent one, which is always
reached from below, would pull the response flat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from ..core.arrays import Float, Int
from ..core.response import MODELS, ResponseSpec
from ..sensing.response import response_of
from .readings import TERMS

# The models of a response, as least squares sees them: linear in their coefficients.

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


_HUBER = 1.5  # residuals beyond so many standard deviations are outliers
_FIRST_NOISE = 0.002
_LEAST_NOISE = 1e-5  # of (R - R0)/R0: no meter shows less
_STEPS = 30
_STILL = 1e-5


@dataclass(frozen=True)
class Data:
    """What is fitted: changes `y` (n,) of (R - R0)/R0 at `strain` (n,) of the piece `piece` (n,),
    an index below `pieces`; what the pieces remember, `memory` (n, TERMS)."""

    y: Float
    strain: Float
    piece: Int
    pieces: int
    memory: Float

    def only(self, keep: Int) -> Data:
        return Data(
            self.y[keep], self.strain[keep], self.piece[keep], self.pieces, self.memory[keep]
        )


@dataclass(frozen=True)
class Fitted:
    """The model with its coefficients `theta`, the pieces' offsets and gains (pieces,), the
    coefficients (TERMS,) of what they remember; the standard deviation `noise` of a reading, and
    the weights (n,) that outliers left to it."""

    model: Model
    theta: Float
    offset: Float
    gain: Float
    memory: Float
    noise: float
    weight: Float

    def predict(self, data: Data) -> Float:
        """Changes (n,) that the fit expects."""
        w = self.model.predict(self.theta, data.strain)
        return self.offset[data.piece] + self.gain[data.piece] * w + data.memory @ self.memory


def fit(
    data: Data, model: Model, spread: float, start: Fitted | None = None, steps: int = _STEPS
) -> Fitted:
    """The model fitted by Gauss-Newton steps, for gains times coefficients are not linear; `spread`
    is the standard deviation expected of the gains. `start` spares steps where a similar fit is
    known."""
    gain = np.ones(data.pieces) if start is None else start.gain
    noise = _FIRST_NOISE if start is None else start.noise
    weight = np.ones(len(data.y))
    design, own = model.design(data.strain), np.eye(data.pieces)[data.piece]
    present, told = own.any(0), data.memory.any(0)
    count = int(present.sum())
    theta, offset, memory = np.zeros(model.size), np.zeros(data.pieces), np.zeros(TERMS)
    if start is not None:
        theta = start.theta
    ends = np.cumsum([model.size, count, told.sum()])
    linear = np.concatenate([own[:, present], data.memory[:, told]], axis=1)
    for step in range(steps):
        before, w = theta, design @ theta
        root = np.sqrt(weight)
        A = np.concatenate([gain[data.piece, None] * design, linear], axis=1)
        b = data.y
        free = spread > 0 and bool(theta.any())
        if free:  # gains: their changes, drawn so that they come to lie about one
            pull = noise / spread
            A = np.concatenate([A, w[:, None] * own[:, present]], axis=1)
            ridge = np.concatenate([np.zeros((count, ends[-1])), pull * np.eye(count)], axis=1)
            A = np.concatenate([A * root[:, None], ridge])
            b = np.concatenate([b * root, pull * (1 - gain[present])])
        else:
            A, b = A * root[:, None], b * root
        theta, offset[present], memory[told], change = np.split(_solve(A, b, model), ends)
        if free:
            gain = gain.copy()
            gain[present] += change
            theta = theta * gain[present].mean()
            gain[present] /= gain[present].mean()
        left = data.y - offset[data.piece] - data.memory @ memory
        left = left - gain[data.piece] * (design @ theta)
        noise = _scale(left, int(ends[-1]))
        weight = np.minimum(1.0, _HUBER * noise / np.maximum(np.abs(left), 1e-300))
        if step > 1 and np.abs(theta - before).max() < _STILL * max(np.abs(theta).max(), 1e-9):
            break
    return Fitted(model, theta, offset, gain, memory, noise, weight)


def _solve(A: Float, b: Float, model: Model) -> Float:
    if not model.rising:
        return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0])
    low = np.where(np.arange(A.shape[1]) < model.size, 0.0, -np.inf)
    return np.asarray(lsq_linear(A, b, bounds=(low, np.inf), method="bvls").x)


def free_gains(data: Data, fitted: Fitted) -> Float:
    """The pieces' gains (pieces,) as their own readings have it, NaN for pieces without any."""
    w = fitted.model.predict(fitted.theta, data.strain)
    y = data.y - data.memory @ fitted.memory
    out = np.full(data.pieces, np.nan)
    for p in np.unique(data.piece):
        own = data.piece == p
        root = np.sqrt(fitted.weight[own])
        A = np.stack([w[own], np.ones(own.sum())], axis=1) * root[:, None]
        out[p] = np.linalg.lstsq(A, y[own] * root, rcond=None)[0][0]
    return out


def _scale(left: Float, used: int) -> float:
    """Robust standard deviation of residuals of a fit with so many coefficients."""
    free = max(len(left) - used, 1)
    middle = 1.4826 * float(np.median(np.abs(left))) * np.sqrt(len(left) / free)
    return float(max(middle, _LEAST_NOISE))
