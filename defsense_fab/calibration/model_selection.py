"""Which model the readings call for, by the error on radii that were left out.

A model with more coefficients must earn them. Its deviance is the sum of squared errors on left-out
radii over the noise's variance, plus that of the pieces' gains over theirs: what it costs to lay a
curve at the door of the pieces. It has to be lower by more than chance would make it, and at the
radii on the whole, not at one of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from .response_fit import ORDER, Data, Fitted, fit, model

#: Deviance that one more coefficient must save: 3.84 is chance at 5 %, but readings on one specimen
#: share hysteresis and relaxation, so it takes more, and a part of the error where they are many.
_PRICE, _PART = 8.0, 0.06
_CLEAR = 1.0  # standard errors by which the mean over radii must be better


@dataclass(frozen=True)
class Tried:
    """A model's fit to all readings; RMSE on radii left out, of (R - R0)/R0; mean squared error of
    each radius `by_radius` (r,) over the noise's variance; how many readings were left out in all;
    what the gains of its pieces cost."""

    fitted: Fitted
    left_out: float
    by_radius: Float
    count: int
    gains: float

    @property
    def deviance(self) -> float:
        return float(self.count * self.by_radius.mean() + self.gains)


def compare(data: Data, radius: Float, spread: float) -> dict[str, Tried]:
    """Every model that the readings can carry; `radius` (n,) mm, NaN for flat ones; `spread` is the
    standard deviation expected of the gains."""
    radii = np.unique(radius[~np.isnan(radius)])
    forms = {name: model(name, data.strain) for name in ORDER}
    forms = {n: f for n, f in forms.items() if f.size <= len(radii) - 1}
    fits = {n: fit(data, f, spread) for n, f in forms.items()}
    best = min(fits.values(), key=lambda f: f.noise)
    errors = {}
    for name, whole in fits.items():
        out = []
        for r in radii:
            rest, own = np.flatnonzero(radius != r), np.flatnonzero(radius == r)
            part = fit(data.only(rest), whole.model, spread, whole)
            left = data.y[own] - part.predict(data.only(own))
            out.append(float(np.average(left**2, weights=best.weight[own])))
        errors[name] = np.array(out)
    variance = max(min(float(e.mean()) for e in errors.values()), 1e-12)
    count = int((~np.isnan(radius)).sum())
    return {
        name: Tried(
            whole,
            float(np.sqrt(errors[name].mean())),
            errors[name] / variance,
            count,
            float(((whole.gain - 1) ** 2).sum() / spread**2) if spread > 0 else 0.0,
        )
        for name, whole in fits.items()
    }


def choose(tried: dict[str, Tried], both: bool = True) -> tuple[str, str]:
    """Its name, and why, in words. Where pieces were not `both` stretched and pressed, a curve may
    be a difference between pieces, and has to earn twice as much."""
    chosen = "line"
    for name in sorted((n for n in tried if n != chosen), key=lambda n: tried[n].fitted.model.size):
        if _better(tried[name], tried[chosen], both):
            chosen = name
    errors = ", ".join(f"{n} {t.left_out:.2%}" for n, t in tried.items())
    if chosen == "line":
        why = "no other model is better by more than chance, so the simplest is taken"
    else:
        more = tried[chosen].fitted.model.size - 1
        saved = tried["line"].deviance - tried[chosen].deviance
        price = _price(tried["line"], both) * more
        why = (
            f"its deviance is {saved:.0f} lower than the line's, and {price:.0f} would do for"
            f" {more} more coefficient{'s' if more > 1 else ''}"
        )
    return chosen, f"{chosen}: {why} (error of (R - R0)/R0 on radii left out: {errors})"


def alike(tried: dict[str, Tried], chosen: str, both: bool = True) -> list[Fitted]:
    """Fits of the models that readings hardly tell from the one that was chosen: their deviance is
    greater by half the price of a coefficient at most."""
    limit = tried[chosen].deviance + _price(tried[chosen], both) / 2
    return [t.fitted for t in tried.values() if t.deviance <= limit]


def _price(tried: Tried, both: bool) -> float:
    return max(_PRICE, _PART * tried.count) * (1 if both else 2)


def _better(new: Tried, old: Tried, both: bool) -> bool:
    """A model of the same size, after it in the order, has to be better by half a coefficient."""
    price = _price(old, both) * max(new.fitted.model.size - old.fitted.model.size, 0.5)
    if old.deviance - new.deviance <= price:
        return False
    saved = old.by_radius - new.by_radius
    clear = saved.mean() > _CLEAR * saved.std(ddof=1) / np.sqrt(len(saved))
    return bool(clear or old.gains - new.gains > price)
