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
from .memory import TERMS
from .models import Model

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
