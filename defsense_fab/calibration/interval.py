"""How far the response can be trusted: a 95 % interval of the slope at rest.

Three doubts. Within pieces, noise, hysteresis and relaxation: a bootstrap over the rounds of each
specimen (over its readings where there was one round). Between pieces: pieces of one cord differ,
and the response of a device's cords is that of yet other pieces' mean; Student's t over the pieces'
own gains. And few pieces can agree by chance: until specimens are many, a spread between specimens
is taken for granted. A percentile bootstrap over two specimens has three different draws, and
misses the truth far too often.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from ..core.arrays import Float, Int
from .fit import Data, Fitted, fit, free_gains

LEVEL = 0.95
DRAWS = 300
#: From so many specimens on only their own spread counts.
_MANY = 6
_NORMAL = 1.96


@dataclass(frozen=True)
class Doubt:
    """Of the slope at rest: its `interval`, the half widths, relative to it, that come of readings
    (`within`), of the pieces' spread (`pieces`), and of the spread taken for granted (`assumed`);
    standard errors of the model's coefficients (size,) by the bootstrap; the draws' slopes."""

    interval: tuple[float, float]
    within: float
    pieces: float
    assumed: float
    errors: Float
    draws: Float


def doubt(
    data: Data,
    fitted: Fitted,
    specimen: Int,
    turn: Int,
    spread: float,
    rng: np.random.Generator,
    draws: int = DRAWS,
) -> Doubt:
    """For readings of the specimens `specimen` (n,) in the rounds `turn` (n,); `spread` is the
    standard deviation between specimens that is taken for granted."""
    slope = fitted.model.slope_at_rest(fitted.theta)
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
    of = np.array([specimen[data.piece == p][0] if np.isfinite(g) else -1
                   for p, g in enumerate(gains)])  # fmt: skip
    used = np.isfinite(gains)
    specimens = len(np.unique(of[used]))
    between = _student(gains[used]) if used.sum() > 2 else 0.0
    if specimens > 2:
        between = max(between, _student([gains[of == s].mean() for s in np.unique(of[used])]))
    assumed = _NORMAL * spread / np.sqrt(specimens) if specimens < _MANY else 0.0
    half = max(between, float(np.hypot(assumed, within))) * abs(slope)
    return Doubt(
        (slope - half, slope + half), within, between, assumed, np.std(thetas, axis=0, ddof=1),
        slopes,
    )  # fmt: skip


def _student(gains: Float | list[float]) -> float:
    """Half the 95 % interval of their mean."""
    n = len(gains)
    return float(student.ppf((1 + LEVEL) / 2, n - 1) * np.std(gains, ddof=1) / np.sqrt(n))


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
