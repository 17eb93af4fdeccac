"""Uncertainty of a fitted response: a 95 % interval of the slope at rest, from four sources.

Within pieces, noise, hysteresis and relaxation: a bootstrap over the rounds of each specimen, or
over its readings where there was one round. Between pieces: pieces of one cord differ, and the
response of a device's cords is the mean of other pieces; Student's t over the pieces' own gains.
Few pieces can agree by chance: until there are many specimens, a spread between specimens is
assumed. Last, models that the readings hardly distinguish have different slopes at rest.

A percentile bootstrap over two specimens has only three different draws, and misses the truth far
too often.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ..core.arrays import Float, Int
from ..core.errors import CalibrationError
from .response_fit import FitData, ResponseFit, fit_gains, fit_model

LEVEL = 0.95
DRAWS = 300
_BOOTSTRAP_STEPS = 6  # of each fit, which starts from the fit to all readings
_MIN_STEEPNESS = 1e-3  # below which the cord is not a sensor
_ASSUMED_SPREAD_PIECES = 4  # number of pieces that the assumed spread counts for
#: From this number of specimens, only their own spread counts.
_MANY_SPECIMENS = 6
_NORMAL_QUANTILE = 1.96


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of the slope at rest.

    Attributes:
        interval: Its 95 % interval.
        within: Half width that comes from the readings, relative to the slope, or to the response's
            steepness where that is larger.
        pieces: Half width that comes from the spread of the pieces, relative to the slope.
        assumed: Half width that comes from the assumed spread, relative to the slope.
        model: Half width that comes from the choice of the model, relative as `within`.
        errors: Standard errors of the model's coefficients (size,), by the bootstrap.
    """

    interval: tuple[float, float]
    within: float
    pieces: float
    assumed: float
    model: float
    errors: Float


def estimate_uncertainty(
    data: FitData,
    fit: ResponseFit,
    others: Sequence[ResponseFit],
    names: Sequence[tuple[str, str]],
    turn: Int,
    spread: float,
    rng: np.random.Generator,
    draws: int,
) -> Uncertainty:
    """Estimate the uncertainty of a fit.

    Args:
        data: Readings.
        fit: The fit.
        others: Fits of other models that explain the readings about as well.
        names: Specimen and position of each piece (pieces).
        turn: Round of each reading (n,).
        spread: Assumed standard deviation between specimens.
        rng: Random generator of the bootstrap.
        draws: Number of bootstrap samples.

    Returns:
        The uncertainty.

    Raises:
        CalibrationError: The cords do not respond to strain.
    """
    slope = fit.model.slope_at_rest(fit.theta)
    steepness = fit.model.steepness(fit.theta, data.strain)
    _require_response(steepness)
    unit = max(abs(slope), steepness)
    thetas = _bootstrap(data, fit, [specimen for specimen, _ in names], turn, spread, rng, draws)
    slopes = np.array([fit.model.slope_at_rest(theta) for theta in thetas])
    within = _NORMAL_QUANTILE * float(slopes.std(ddof=1)) / unit
    gains = fit_gains(data, fit)
    measured = [p for p in range(len(names)) if np.isfinite(gains[p])]
    # A piece that was measured in several sessions is still one piece.
    pieces = [
        np.mean([gains[q] for q in measured if names[q] == name])
        for name in dict.fromkeys(names[p] for p in measured)
    ]
    specimens = [
        np.mean([gains[q] for q in measured if names[q][0] == specimen])
        for specimen in dict.fromkeys(names[p][0] for p in measured)
    ]
    few = len(specimens) < _MANY_SPECIMENS
    assumed = _NORMAL_QUANTILE * spread / np.sqrt(len(specimens)) if few else 0.0
    between = _pooled_half_width(pieces, spread if assumed else 0.0)
    if len(specimens) > 2:
        between = max(between, _student_half_width(specimens))
    differences = [(f.model.slope_at_rest(f.theta) - slope) / unit for f in others]
    choice = 0.0
    if differences:
        choice = _NORMAL_QUANTILE * float(np.sqrt(np.mean(np.square(differences))))
    readings = float(np.hypot(assumed * abs(slope), within * unit))
    half = float(np.hypot(max(between * abs(slope), readings), choice * unit))
    errors = np.std(thetas, axis=0, ddof=1)
    return Uncertainty((slope - half, slope + half), within, between, assumed, choice, errors)


def _require_response(steepness: float) -> None:
    if steepness < _MIN_STEEPNESS:
        raise CalibrationError(
            f"the cords do not respond to strain (a change of {steepness:.4f} times the strain)",
            code="no-strain-response",
            where="readings",
            action="Check that the cords are piezoresistive and the channels in the right order",
            steepness=steepness,
        )


def _bootstrap(
    data: FitData,
    fit: ResponseFit,
    specimens: Sequence[str],
    turn: Int,
    spread: float,
    rng: np.random.Generator,
    draws: int,
) -> list[Float]:
    """Return the coefficients of fits to bootstrap samples; `specimens` is by piece."""
    specimen = np.array([specimens.index(s) for s in specimens], int)[data.piece]
    thetas = []
    for _ in range(draws):
        part = data.only(_draw(specimen, turn, rng))
        if len(np.unique(part.strain)) <= fit.model.size:
            continue
        thetas.append(fit_model(part, fit.model, spread, fit, _BOOTSTRAP_STEPS).theta)
    return thetas


def _student_half_width(gains: Sequence[float]) -> float:
    """Return half the 95 % interval of the mean of gains."""
    n = len(gains)
    return float(stdtrit(n - 1, (1 + LEVEL) / 2) * np.std(gains, ddof=1) / np.sqrt(n))


def _pooled_half_width(gains: Sequence[float], spread: float) -> float:
    """Return half the 95 % interval of the mean of gains.

    Few gains are pooled with an expected spread, which counts for further pieces.
    """
    n = len(gains)
    if n < 2:
        return 0.0
    squares = float(((np.array(gains) - np.mean(gains)) ** 2).sum())
    freedom = _ASSUMED_SPREAD_PIECES + n - 1 if spread else n - 1
    pooled = np.sqrt((_ASSUMED_SPREAD_PIECES * spread**2 + squares) / freedom)
    half = float(stdtrit(freedom, (1 + LEVEL) / 2) * pooled / np.sqrt(n))
    return max(half, _student_half_width(gains)) if n > 2 else half


def _draw(specimen: Int, turn: Int, rng: np.random.Generator) -> Int:
    """Return the indices of one bootstrap sample.

    As many rounds of each specimen as it has are drawn with replacement; of a specimen with one
    round, readings are drawn.
    """
    out = []
    for s in np.unique(specimen):
        indices = np.flatnonzero(specimen == s)
        rounds = np.unique(turn[indices])
        if len(rounds) > 1:
            drawn = rng.choice(rounds, len(rounds))
            out += [indices[turn[indices] == r] for r in drawn]
        else:
            out.append(rng.choice(indices, len(indices)))
    return np.concatenate(out)
