"""How far the response can be trusted: a 95 % interval of the slope at rest.

Four doubts. Within pieces, noise, hysteresis and relaxation: a bootstrap over the rounds of each
specimen (over its readings where there was one round). Between pieces: pieces of one cord differ,
and the response of a device's cords is that of yet other pieces' mean; Student's t over the pieces'
own gains. And few pieces can agree by chance: until specimens are many, a spread between specimens
is taken for granted. Last, models that the readings hardly tell apart have other slopes at rest. A
percentile bootstrap over two specimens has three different draws, and misses the truth far too
often.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from ..core.arrays import Float, Int
from ..core.errors import CalibrationError
from .response_fit import Data, Fitted, fit, free_gains

LEVEL = 0.95
DRAWS = 300
_DEAD = 1e-3  # k_res of what is no sensor
_PRIOR = 4
#: From so many specimens on only their own spread counts.
_MANY = 6
_NORMAL = 1.96


@dataclass(frozen=True)
class Doubt:
    """Of the slope at rest: its `interval`, the half widths, relative to it, that come of readings
    (`within`), of the pieces' spread (`pieces`), of the spread taken for granted (`assumed`), and
    of the choice of the model (`model`); standard errors of the model's coefficients (size,) by the
    bootstrap."""

    interval: tuple[float, float]
    within: float
    pieces: float
    assumed: float
    model: float
    errors: Float


def doubt(
    data: Data,
    fitted: Fitted,
    others: Sequence[Fitted],
    names: Sequence[tuple[str, str]],
    turn: Int,
    spread: float,
    rng: np.random.Generator,
    draws: int = DRAWS,
) -> Doubt:
    """For readings in the rounds `turn` (n,); `others` are fits that explain them about as well;
    `names` (pieces,) are the pieces' specimens and
    places; `spread` is the standard deviation between specimens that is taken for granted."""
    slope = fitted.model.slope_at_rest(fitted.theta)
    if abs(slope) < _DEAD:
        raise CalibrationError(
            f"the cords do not answer to strain (k_res {slope:.4f}): are they the piezoresistive"
            " ones, and are the channels in order?",
            code="no-strain-response",
            k_res=slope,
        )
    labels = [one for one, _ in names]
    specimen = np.array([labels.index(one) for one in labels], int)[data.piece]
    thetas = []
    for _ in range(draws):
        keep = _draw(specimen, turn, rng)
        part = data.only(keep)
        if len(np.unique(part.strain)) <= fitted.model.size:
            continue
        thetas.append(fit(part, fitted.model, spread, fitted, steps=6).theta)
    slopes = np.array([fitted.model.slope_at_rest(theta) for theta in thetas])
    within = _NORMAL * float(slopes.std(ddof=1)) / abs(slope)
    gains = free_gains(data, fitted)
    # Measured in several sessions, a piece is still one piece.
    named = {p: (specimen_of, place) for p, (specimen_of, place) in enumerate(names)}
    known = [p for p in named if np.isfinite(gains[p])]
    pieces = [np.mean([gains[q] for q in known if named[q] == one])
              for one in dict.fromkeys(named[p] for p in known)]  # fmt: skip
    means = [np.mean([gains[q] for q in known if named[q][0] == one])
             for one in dict.fromkeys(named[p][0] for p in known)]  # fmt: skip
    assumed = _NORMAL * spread / np.sqrt(len(means)) if len(means) < _MANY else 0.0
    between = _pooled(pieces, spread if assumed else 0.0)
    if len(means) > 2:
        between = max(between, _student(means))
    apart = [f.model.slope_at_rest(f.theta) / slope - 1 for f in others]
    choice = _NORMAL * float(np.sqrt(np.mean(np.square(apart)))) if apart else 0.0
    half = float(np.hypot(max(between, float(np.hypot(assumed, within))), choice)) * abs(slope)
    errors = np.std(thetas, axis=0, ddof=1)
    return Doubt((slope - half, slope + half), within, between, assumed, choice, errors)


def _student(gains: Sequence[float]) -> float:
    """Half the 95 % interval of their mean."""
    n = len(gains)
    return float(student.ppf((1 + LEVEL) / 2, n - 1) * np.std(gains, ddof=1) / np.sqrt(n))


def _pooled(gains: Sequence[float], spread: float) -> float:
    """The same, but where they are few no less than their own spread pooled with the expected one
    gives, which counts as much as `_PRIOR` more pieces do."""
    n = len(gains)
    if n < 2:
        return 0.0
    own = float(((np.array(gains) - np.mean(gains)) ** 2).sum())
    free = _PRIOR + n - 1 if spread else n - 1
    pooled = np.sqrt((_PRIOR * spread**2 + own) / free)
    half = float(student.ppf((1 + LEVEL) / 2, free) * pooled / np.sqrt(n))
    return max(half, _student(gains)) if n > 2 else half


def _draw(specimen: Int, turn: Int, rng: np.random.Generator) -> Int:
    """Indices of one bootstrap sample: as many rounds of each specimen as it has, drawn with
    putting back; of a specimen with one round its readings."""
    out = []
    for s in np.unique(specimen):
        own = np.flatnonzero(specimen == s)
        rounds = np.unique(turn[own])
        if len(rounds) > 1:
            drawn = rng.choice(rounds, len(rounds))
            out += [own[turn[own] == r] for r in drawn]
        else:
            out.append(rng.choice(own, len(own)))
    return np.concatenate(out)
