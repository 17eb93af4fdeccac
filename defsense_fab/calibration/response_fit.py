"""Fit one model of the response to the readings of all pieces of cord.

A reading of piece p is y = (R - R0)/R0 = c_p + g_p w(eps) + noise. Flat readings are readings like
others, so the error c_p of R0 is fitted, too. Pieces differ: the gain g_p, one on average, is
pulled towards one like a normal variable of a known standard deviation (a ridge). That separates it
from a true difference between tension and compression where pieces only experienced one of them.
Outliers have less weight (Huber 1964).

Where the earlier strains of a piece are known, further terms describe its memory of them. Without
these terms, the least bent jig, which is always reached from higher strains, and the most bent one,
which is always reached from lower strains, would flatten the response.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from ..core.arrays import Float, Int
from ..core.response import MODELS, ResponseSpec
from ..sensing.response import build_response
from .readings import MEMORY_TERMS

#: Models from the simplest to the most flexible.
MODEL_ORDER = ("line", "quadratic", "two-slopes", "cubic", "piecewise")
_SIZES = {"line": 1, "two-slopes": 2, "quadratic": 2, "cubic": 3}
_KNOTS_PER_SIDE = 3  # of the piecewise model, on either side of rest
_MIN_KNOT_DISTANCE = 1e-4  # strain

_HUBER_SIGMAS = 1.5  # residuals beyond this number of standard deviations are outliers
_INITIAL_NOISE = 0.002
_MIN_NOISE = 1e-5  # of (R - R0)/R0: no meter resolves less
_MAX_STEPS = 30
_CONVERGENCE_RTOL = 1e-5


@dataclass(frozen=True)
class ResponseModel:
    """Model w(eps) = design(eps) @ theta, linear in its coefficients.

    Attributes:
        name: Name of the model.
        knots: Strains (k,), 0 included, of the piecewise model. Its theta are the rises between
            them, or the falls, which must not be negative.
        is_falling: Whether the piecewise model falls.
    """

    name: str
    knots: Float
    is_falling: bool = False

    @property
    def is_monotone(self) -> bool:
        """Whether the coefficients must not be negative."""
        return self.name == "piecewise"

    @property
    def _sign(self) -> float:
        return -1.0 if self.is_falling else 1.0

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return _SIZES.get(self.name, len(self.knots) - 1)

    def design(self, strain: Float) -> Float:
        """Return the design matrix (n, size) for strains (n,)."""
        e = np.asarray(strain, float)
        if self.name == "two-slopes":
            return np.stack([np.maximum(e, 0), np.minimum(e, 0)], axis=1)
        if not self.is_monotone:
            return np.stack([e**power for power in range(1, self.size + 1)], axis=1)
        low, high = self.knots[:-1], self.knots[1:]
        shares = np.clip((e[:, None] - low) / (high - low), 0, 1)
        return self._sign * np.asarray(shares - np.clip(-low / (high - low), 0, 1))

    def spec(self, theta: Float, strain_range: tuple[float, float]) -> ResponseSpec:
        """Return the record of a response.

        Args:
            theta: Coefficients (size,).
            strain_range: Lowest and highest measured strain.
        """
        if self.name == "piecewise":
            changes = self._sign * np.concatenate([[0.0], np.cumsum(theta)])
            rest = int(np.flatnonzero(self.knots == 0)[0])
            values: dict[str, object] = {
                "strains": self.knots.tolist(),
                "changes": (changes - changes[rest]).tolist(),
            }
        else:
            values = dict(zip(MODELS[self.name], map(float, theta), strict=True))
        return ResponseSpec(self.name, values, strain_range)

    def predict(self, theta: Float, strain: Float) -> Float:
        """Return w at strains (n,).

        For the piecewise model it is the smooth curve through its knots, which devices use.
        """
        if not self.is_monotone:
            return self.design(strain) @ theta
        ends = float(self.knots[0]), float(self.knots[-1])
        return np.asarray(build_response(self.spec(theta, ends))(strain))

    def steepness(self, theta: Float, strain: Float) -> float:
        """Return the root mean square of w over that of the strains (n,).

        It is the slope of a line, and also tells of a response with no slope at rest.
        """
        rms = np.sqrt(np.mean(np.square([self.predict(theta, strain), strain]), axis=1))
        return float(rms[0] / rms[1])

    def slope_at_rest(self, theta: Float) -> float:
        """Return dw/deps at zero strain; for two slopes, their mean."""
        if self.name == "two-slopes":
            return float(theta.mean())
        if self.name == "piecewise":
            low, high = float(self.knots[0]), float(self.knots[-1])
            return float(build_response(self.spec(theta, (low, high))).slope(np.array(0.0)))
        return float(theta[0])


def build_model(name: str, strain: Float, is_falling: bool = False) -> ResponseModel:
    """Return the model of a name for data at strains (n,), whose changes rise or fall with them."""
    if name != "piecewise":
        return ResponseModel(name, np.zeros(0))
    return ResponseModel(name, _choose_knots(strain), is_falling)


def _choose_knots(strain: Float) -> Float:
    """Return rest and, on either side of it, quantiles of the measured strains."""
    shares = np.linspace(0, 1, _KNOTS_PER_SIDE + 1)
    out = [np.zeros(1)]
    for side, inner in (
        (strain[strain < -_MIN_KNOT_DISTANCE], shares[:-1]),
        (strain[strain > _MIN_KNOT_DISTANCE], shares[1:]),
    ):
        if len(side):
            out.append(np.quantile(np.unique(side), inner))
    knots = np.sort(np.concatenate(out))
    return np.asarray(knots[np.append(True, np.diff(knots) > _MIN_KNOT_DISTANCE)])


@dataclass(frozen=True)
class FitData:
    """Readings to fit.

    Attributes:
        y: Changes (R - R0)/R0 (n,).
        strain: Strains (n,).
        piece: Index of the piece (n,), below `pieces`.
        pieces: Number of pieces.
        memory: Memory terms (n, MEMORY_TERMS).
    """

    y: Float
    strain: Float
    piece: Int
    pieces: int
    memory: Float

    def only(self, indices: Int) -> FitData:
        """Return some of the readings."""
        return FitData(
            self.y[indices],
            self.strain[indices],
            self.piece[indices],
            self.pieces,
            self.memory[indices],
        )


@dataclass(frozen=True)
class ResponseFit:
    """A fitted model.

    Attributes:
        model: The model.
        theta: Its coefficients (size,).
        offset: Offset of each piece (pieces,).
        gain: Gain of each piece (pieces,).
        memory: Coefficients of the memory terms (MEMORY_TERMS,).
        noise: Standard deviation of a reading.
        weight: Weight of each reading (n,), lower for outliers.
    """

    model: ResponseModel
    theta: Float
    offset: Float
    gain: Float
    memory: Float
    noise: float
    weight: Float

    def predict(self, data: FitData) -> Float:
        """Return the changes (n,) that the fit expects."""
        w = self.model.predict(self.theta, data.strain)
        return self.offset[data.piece] + self.gain[data.piece] * w + data.memory @ self.memory


def fit_model(
    data: FitData,
    model: ResponseModel,
    spread: float,
    start: ResponseFit | None = None,
    max_steps: int = _MAX_STEPS,
) -> ResponseFit:
    """Fit a model by Gauss-Newton steps, since products of gains and coefficients are not linear.

    Args:
        data: Readings.
        model: The model.
        spread: Expected standard deviation of the gains.
        start: A similar fit to start from, which saves steps.
        max_steps: Largest number of steps.

    Returns:
        The fit.
    """
    gain = np.ones(data.pieces) if start is None else start.gain
    noise = _INITIAL_NOISE if start is None else start.noise
    weight = np.ones(len(data.y))
    design, indicator = model.design(data.strain), np.eye(data.pieces)[data.piece]
    is_present, has_memory = indicator.any(0), data.memory.any(0)
    count = int(is_present.sum())
    theta, offset, memory = np.zeros(model.size), np.zeros(data.pieces), np.zeros(MEMORY_TERMS)
    if start is not None:
        theta = start.theta
    ends = np.cumsum([model.size, count, has_memory.sum()])
    linear = np.concatenate([indicator[:, is_present], data.memory[:, has_memory]], axis=1)
    for step in range(max_steps):
        before, w = theta, design @ theta
        root = np.sqrt(weight)
        A = np.concatenate([gain[data.piece, None] * design, linear], axis=1)
        b = data.y
        fits_gains = spread > 0 and bool(theta.any())
        if fits_gains:  # by their changes, with a ridge that pulls the gains towards one
            pull = noise / spread
            A = np.concatenate([A, w[:, None] * indicator[:, is_present]], axis=1)
            ridge = np.concatenate([np.zeros((count, ends[-1])), pull * np.eye(count)], axis=1)
            A = np.concatenate([A * root[:, None], ridge])
            b = np.concatenate([b * root, pull * (1 - gain[is_present])])
        else:
            A, b = A * root[:, None], b * root
        theta, offset[is_present], memory[has_memory], change = np.split(_solve(A, b, model), ends)
        if fits_gains:
            gain = gain.copy()
            gain[is_present] += change
            theta = theta * gain[is_present].mean()
            gain[is_present] /= gain[is_present].mean()
        residual = data.y - offset[data.piece] - data.memory @ memory
        residual = residual - gain[data.piece] * (design @ theta)
        noise = _robust_deviation(residual, int(ends[-1]))
        weight = np.minimum(1.0, _HUBER_SIGMAS * noise / np.maximum(np.abs(residual), 1e-300))
        tolerance = _CONVERGENCE_RTOL * max(np.abs(theta).max(), 1e-9)
        if step > 1 and np.abs(theta - before).max() < tolerance:
            break
    return ResponseFit(model, theta, offset, gain, memory, noise, weight)


def _solve(A: Float, b: Float, model: ResponseModel) -> Float:
    if not model.is_monotone:
        return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0])
    low = np.where(np.arange(A.shape[1]) < model.size, 0.0, -np.inf)
    return np.asarray(lsq_linear(A, b, bounds=(low, np.inf), method="bvls").x)


def fit_gains(data: FitData, fit: ResponseFit) -> Float:
    """Fit each piece's gain to its own readings alone, without the ridge.

    Args:
        data: Readings.
        fit: A fit to all of them.

    Returns:
        Gains (pieces,); NaN for pieces without readings.
    """
    w = fit.model.predict(fit.theta, data.strain)
    y = data.y - data.memory @ fit.memory
    out = np.full(data.pieces, np.nan)
    for p in np.unique(data.piece):
        is_own = data.piece == p
        root = np.sqrt(fit.weight[is_own])
        A = np.stack([w[is_own], np.ones(is_own.sum())], axis=1) * root[:, None]
        out[p] = np.linalg.lstsq(A, y[is_own] * root, rcond=None)[0][0]
    return out


def _robust_deviation(residual: Float, coefficients: int) -> float:
    """Return a robust standard deviation of the residuals of a fit."""
    freedom = max(len(residual) - coefficients, 1)
    deviation = 1.4826 * float(np.median(np.abs(residual))) * np.sqrt(len(residual) / freedom)
    return float(max(deviation, _MIN_NOISE))
