"""Calibrate a cord: from readings on specimens to its response with an interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Float, Int
from ..core.errors import CalibrationError
from ..core.progress import Notice
from ..core.response import ResponseSpec
from ..sensing.response import relative_change
from .interval import DRAWS, Uncertainty, estimate_uncertainty
from .model_selection import ModelTrial, choose_model, compare_models, similar_fits
from .options import FitOptions
from .reading_checks import (
    POLICIES,
    Drift,
    check_readings,
    find_drift,
    require_no_drift,
)
from .readings import Piece, Readings
from .response_fit import FitData, ResponseFit, fit_gains

_DRIFT_CODES = {"correct": "drift-corrected", "ignore": "drift-ignored"}
_MIN_K_RES = 0.05  # below which the slope is not significant
_WIDE_INTERVAL = 0.25  # relative half width
_UNUSUAL_GAIN = 0.2  # difference from one
_DEFAULT_FIT = FitOptions()
_MAX_REST_RATIO = 1.1  # R0 of one piece at two times; beyond it there are two pieces


@dataclass(frozen=True)
class Calibration:
    """A calibrated response and its uncertainty.

    Attributes:
        response: The response.
        k_res: Its slope at rest.
        uncertainty: Uncertainty of that slope.
        reason: Why this model was chosen.
        trials: All models, by name.
        data: Readings of the outer cords as they were fitted.
        readings: Readings of the outer cords.
        gains: Gain of each piece (pieces,), NaN for pieces without readings.
        drift: Drift of the neutral cords.
        neutral_changes: Changes (m,) of the neutral cords.
        neutral_radius: Radii (m,) of their jigs, mm.
        warnings: Doubts about the readings and the fit.
    """

    response: ResponseSpec
    k_res: float
    uncertainty: Uncertainty
    reason: str
    trials: Mapping[str, ModelTrial]
    data: FitData
    readings: Readings
    gains: Float
    drift: Drift
    neutral_changes: Float
    neutral_radius: Float
    warnings: tuple[Notice, ...]

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """Pieces of the outer cords."""
        return self.readings.pieces

    @property
    def noise(self) -> float:
        """Standard deviation of a reading."""
        return self.trials[self.response.model].fit.noise


def calibrate(
    readings: Readings,
    options: FitOptions = _DEFAULT_FIT,
    *,
    rng: np.random.Generator | None = None,
    draws: int = DRAWS,
) -> Calibration:
    """Fit the response of the cord in specimens.

    Args:
        readings: Readings of all cords.
        options: Options of the fit.
        rng: Random generator of the bootstrap; by default one with seed 1.
        draws: Number of bootstrap samples.

    Returns:
        The response with its uncertainty.

    Raises:
        CalibrationError: Readings are not possible, there are too few radii, or the neutral cord
            drifts and `options.neutral` is "refuse".
    """
    spread = options.spread / 100
    warnings = check_readings(readings)
    changes = readings.changes()
    noise = _fit_chosen_model(*_select_outer(readings, changes), spread).noise
    drift = find_drift(readings, changes, noise)
    warnings += _drift_notices(drift, options)
    used = POLICIES[options.neutral](readings)
    outer = used.only(~used.neutral)
    data, radius = _select_outer(used, used.changes())
    data = _relative_to_rest(data, radius, spread)
    trials = compare_models(data, radius, spread)
    chosen, reason = _choose_model(trials, len(outer.radii), data, options)
    fit = trials[chosen].fit
    uncertainty = estimate_uncertainty(
        data,
        fit,
        similar_fits(trials, chosen, _has_both_signs(data)),
        [(p.specimen, p.place) for p in outer.pieces],
        outer.turn,
        spread,
        rng or np.random.default_rng(1),
        draws,
    )
    strains = (float(data.strain.min()), float(data.strain.max()))
    gains = fit_gains(data, fit)
    k_res = fit.model.slope_at_rest(fit.theta)
    inside = readings.neutral & ~readings.flat
    warnings += _slope_notices(k_res, uncertainty, data, fit)
    warnings += _piece_notices(outer, gains, data)
    return Calibration(
        response=fit.model.spec(fit.theta, strains),
        k_res=k_res,
        uncertainty=uncertainty,
        reason=reason,
        trials=trials,
        data=data,
        readings=outer,
        gains=gains,
        drift=drift,
        neutral_changes=changes[inside],
        neutral_radius=readings.radius[inside],
        warnings=tuple(warnings),
    )


def _drift_notices(drift: Drift, options: FitOptions) -> list[Notice]:
    """Return a notice on a drift of the neutral cord that is treated, or refuse it."""
    if options.neutral == "refuse":
        require_no_drift(drift)
    elif drift.is_significant and drift.largest is not None:
        is_corrected = options.neutral == "correct"
        treatment = "subtracted from the other cords" if is_corrected else "ignored"
        text = f"the neutral cord changes by {drift.largest:+.2%} ({drift.at}): {treatment}"
        return [Notice(_DRIFT_CODES[options.neutral], text)]
    return []


def _choose_model(
    trials: dict[str, ModelTrial], count: int, data: FitData, options: FitOptions
) -> tuple[str, str]:
    """Return the requested model, or the one that readings on `count` radii support, and why."""
    chosen, reason = choose_model(trials, _has_both_signs(data))
    model = options.model
    if model is None:
        return chosen, reason
    if model not in trials:
        raise CalibrationError(
            f"needs more radii than the {count} that were measured",
            code="too-few-radii",
            where=f"model {model!r}",
            action=f"Choose {' or '.join(trials)}, or measure on more jigs",
            model=model,
            count=count,
        )
    return model, f"{model}, as requested; the default would be {reason}"


def _select_outer(readings: Readings, changes: Float) -> tuple[FitData, Float]:
    """Return the readings of the outer cords for fitting, and their radii."""
    is_outer = ~readings.neutral
    data = FitData(
        changes[is_outer],
        readings.strain[is_outer],
        readings.piece[is_outer],
        len(readings.pieces),
        readings.memory[is_outer],
    )
    return data, readings.radius[is_outer]


def _relative_to_rest(data: FitData, radius: Float, spread: float) -> FitData:
    """Return changes from the resistances that a fit expects at rest and without memory.

    Flat readings have a memory, too.
    """
    rest = 1 + _fit_chosen_model(data, radius, spread).offset[data.piece]
    return replace(data, y=relative_change(1 + data.y, rest))


def _fit_chosen_model(data: FitData, radius: Float, spread: float) -> ResponseFit:
    """Return the fit of the model that is chosen, for its noise and offsets."""
    trials = compare_models(data, radius, spread)
    return trials[choose_model(trials, _has_both_signs(data))[0]].fit


def _slope_notices(
    k_res: float, uncertainty: Uncertainty, data: FitData, fit: ResponseFit
) -> list[Notice]:
    """Return doubts about the slope and the shape of the response."""
    out = []
    low, high = uncertainty.interval
    strain = np.linspace(data.strain.min(), data.strain.max(), 200)
    falls = np.diff(fit.model.predict(fit.theta, strain)) * np.sign(k_res) < 0
    if high < 0:
        text = (
            f"resistances decrease where the cord is stretched (k_res = {k_res:.2f}), as those of"
            " some conductive filaments do. Of other cords, check whether top and bottom were"
            " exchanged; the bottom cord is next to the jig"
        )
        out.append(Notice("resistance-falls", text))
    elif low < _MIN_K_RES and not falls.any():
        text = (
            f"k_res = {k_res:.2f} is not significantly different from zero: check the cord's"
            " connection"
        )
        out.append(Notice("response-insignificant", text))
    if falls.any():
        turn = float(np.abs(strain[:-1][falls]).min())
        text = (
            f"the response is not monotone (it turns near a strain of {turn:.1%}), so one"
            ' resistance belongs to two strains; the models "line" and "piecewise" are monotone'
        )
        out.append(Notice("response-not-monotone", text))
    if high - low > 2 * _WIDE_INTERVAL * max(abs(k_res), fit.model.steepness(fit.theta, strain)):
        text = (
            f"k_res is only known to be between {low:.2f} and {high:.2f}: measure more rounds or"
            " more specimens"
        )
        out.append(Notice("interval-wide", text))
    return out


def _piece_notices(outer: Readings, gains: Float, data: FitData) -> list[Notice]:
    """Return doubts about single pieces and about the differences between them."""
    out = []
    for p, gain in enumerate(gains):
        if np.isfinite(gain) and abs(gain - 1) > _UNUSUAL_GAIN:
            text = (
                f"the response of the cord {outer.pieces[p].name} is {gain:.2f} times the mean:"
                " check its joints and its position"
            )
            out.append(Notice("gain-unusual", text))
    rest = outer.resistance / (1 + outer.changes())
    for cord in {(p.specimen, p.place) for p in outer.pieces}:
        indices = [k for k, p in enumerate(outer.pieces) if (p.specimen, p.place) == cord]
        own_rest = rest[np.isin(outer.piece, indices)]
        if len(own_rest) and own_rest.max() > _MAX_REST_RATIO * own_rest.min():
            text = (
                f"the {cord[1]} cord of specimen {cord[0]!r} has {own_rest.min():.0f} ohm at rest"
                f" in one source and {own_rest.max():.0f} ohm in another: if these are two"
                " specimens, give them different names, so that they count as two"
            )
            out.append(Notice("rest-differs", text))
    if not _has_both_signs(data):
        text = (
            "every piece was either only stretched or only compressed, so differences between the"
            " two cannot be separated from differences between pieces: turn the specimen over for"
            " some rounds (column face)"
        )
        out.append(Notice("one-face-only", text))
    return out


def _has_both_signs(data: FitData) -> bool:
    """Return whether some piece was both stretched and compressed."""
    sign: Int = np.sign(np.round(data.strain, 9)).astype(int)
    return any({-1, 1} <= set(sign[data.piece == p].tolist()) for p in np.unique(data.piece))
