"""Choose the model that the readings support, by its error on radii excluded from the fit.

A model with more coefficients must be better by more than chance. Its deviance is the sum of
squared errors on excluded radii over the variance of the noise, plus that of the pieces' gains over
theirs: the cost of attributing a curve to differences between pieces. The improvement must appear
at the radii on the whole, not at one of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from .response_fit import MODEL_ORDER, FitData, ResponseFit, build_model, fit_model

#: Deviance that one more coefficient must save. Chance at 5 % is 3.84, but readings on one specimen
#: share hysteresis and relaxation, so more is required, and a share of the number of readings where
#: there are many.
_MIN_SAVING, _SAVING_PER_READING = 8.0, 0.06
_IMPROVEMENT_SIGMAS = 1.0  # standard errors by which the mean over radii must be better


@dataclass(frozen=True)
class ModelTrial:
    """A model and its error on excluded radii.

    Attributes:
        fit: Fit to all readings.
        left_out_rmse: RMSE of (R - R0)/R0 on excluded radii.
        by_radius: Mean squared error of each radius (r,) over the variance of the noise.
        count: Number of readings that were excluded in all.
        gains: Cost of the pieces' gains.
    """

    fit: ResponseFit
    left_out_rmse: float
    by_radius: Float
    count: int
    gains: float

    @property
    def deviance(self) -> float:
        """Deviance by which models are compared."""
        return float(self.count * self.by_radius.mean() + self.gains)


def compare_models(data: FitData, radius: Float, spread: float) -> dict[str, ModelTrial]:
    """Fit every model for which there are enough radii.

    Args:
        data: Readings.
        radius: Radius of the jig of each reading (n,), mm; NaN for flat ones.
        spread: Expected standard deviation of the gains.

    Returns:
        The trials by the models' names.
    """
    radii = np.unique(radius[~np.isnan(radius)])
    line = fit_model(data, build_model("line", data.strain), spread)
    is_falling = bool(line.theta[0] < 0)
    models = {name: build_model(name, data.strain, is_falling) for name in MODEL_ORDER}
    models = {n: m for n, m in models.items() if m.size <= len(radii) - 1}
    fits = {n: fit_model(data, m, spread) for n, m in models.items()}
    best = min(fits.values(), key=lambda f: f.noise)
    errors = {}
    for name, fit in fits.items():
        out = []
        for r in radii:
            others, excluded = np.flatnonzero(radius != r), np.flatnonzero(radius == r)
            part = fit_model(data.only(others), fit.model, spread, fit)
            residual = data.y[excluded] - part.predict(data.only(excluded))
            out.append(float(np.average(residual**2, weights=best.weight[excluded])))
        errors[name] = np.array(out)
    variance = max(min(float(e.mean()) for e in errors.values()), 1e-12)
    count = int((~np.isnan(radius)).sum())
    return {
        name: ModelTrial(
            fit,
            float(np.sqrt(errors[name].mean())),
            errors[name] / variance,
            count,
            float(((fit.gain - 1) ** 2).sum() / spread**2) if spread > 0 else 0.0,
        )
        for name, fit in fits.items()
    }


def choose_model(trials: dict[str, ModelTrial], both: bool) -> tuple[str, str]:
    """Choose a model.

    Args:
        trials: Trials by the models' names.
        both: Whether pieces were both stretched and compressed. Otherwise a curve may be a
            difference between pieces, and must save twice as much.

    Returns:
        The model's name, and the reason in words.
    """
    chosen = "line"
    others = (n for n in trials if n != chosen)
    for name in sorted(others, key=lambda n: trials[n].fit.model.size):
        if _is_better(trials[name], trials[chosen], both):
            chosen = name
    errors = ", ".join(f"{n} {t.left_out_rmse:.2%}" for n, t in trials.items())
    if chosen == "line":
        reason = "the simplest, since no other model is better by more than chance"
    else:
        more = trials[chosen].fit.model.size - 1
        saving = trials["line"].deviance - trials[chosen].deviance
        required = _required_saving(trials["line"], both) * more
        reason = (
            f"its deviance is {saving:.0f} lower than the line's; {required:.0f} is required for"
            f" {more} more coefficient{'s' if more > 1 else ''}"
        )
    return chosen, f"{chosen}: {reason} (error of (R - R0)/R0 on excluded radii: {errors})"


def similar_fits(trials: dict[str, ModelTrial], chosen: str, both: bool) -> list[ResponseFit]:
    """Return the fits of all models of about the same quality as the chosen one.

    Their deviance is greater by at most half of what a coefficient must save.

    Args:
        trials: Trials by the models' names.
        chosen: Name of the chosen model.
        both: As in `choose_model`.
    """
    limit = trials[chosen].deviance + _required_saving(trials[chosen], both) / 2
    return [t.fit for t in trials.values() if t.deviance <= limit]


def _required_saving(trial: ModelTrial, both: bool) -> float:
    return max(_MIN_SAVING, _SAVING_PER_READING * trial.count) * (1 if both else 2)


def _is_better(new: ModelTrial, old: ModelTrial, both: bool) -> bool:
    """Compare trials; a later model of the same size must save as much as half a coefficient."""
    more = max(new.fit.model.size - old.fit.model.size, 0.5)
    required = _required_saving(old, both) * more
    if old.deviance - new.deviance <= required:
        return False
    saving = old.by_radius - new.by_radius
    is_clear = saving.mean() > _IMPROVEMENT_SIGMAS * saving.std(ddof=1) / np.sqrt(len(saving))
    return bool(is_clear or old.gains - new.gains > required)
