"""Check readings: implausible resistances, and drift of the cord in the neutral plane.

The neutral cord must not respond to bending. Where it does, something other than strain acts on the
cords.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Bool, Float
from ..core.errors import CalibrationError
from ..core.progress import Notice
from .readings import MIN_RADII, Readings

#: A cord on a jig changes by a tenth or two; beyond this it is broken or shorted.
_MAX_CHANGE = 0.8
#: Ratio of readings in kohm and in ohm.
_KILO = 1000.0
#: Pieces of 100 mm and more of any rubber cord have far more than this.
_LOW_RESISTANCE_OHM = 20.0
_REPAIR_ACTION = "Repair the cord and measure again, or delete the row"

#: A drift is significant from this fraction of the outer cords' largest change,
_MIN_DRIFT_SHARE = 0.05
#: and from this number of standard errors of the mean.
_DRIFT_SIGMAS = 5.0
_MIN_NOISE = 1e-5  # of (R - R0)/R0
_MIN_READINGS_FOR_NOISE = 5


def check_readings(readings: Readings) -> list[Notice]:
    """Check whether readings are plausible.

    Args:
        readings: Readings of all cords.

    Returns:
        Doubts that do not prevent a fit.

    Raises:
        CalibrationError: There are too few radii, a reading is not possible, or units are mixed.
    """
    outer = readings.only(~readings.neutral)
    if len(outer.radii) < MIN_RADII:
        radii = ", ".join(f"{r:g}" for r in outer.radii) or "none"
        raise CalibrationError(
            f"there are {len(outer.radii)} different jig radii ({radii})",
            code="too-few-radii",
            where="readings",
            action=f"Measure on at least {MIN_RADII} jigs",
            count=len(outer.radii),
        )
    for ohm, where in zip(readings.resistance, readings.where, strict=True):
        if not (np.isfinite(ohm) and ohm > 0):
            state = "shorted" if ohm == 0 else "open"
            raise CalibrationError(
                f"{ohm:g} ohm means that the cord or its joints are {state}",
                code="impossible-resistance",
                where=where,
                action=_REPAIR_ACTION,
                place=where,
                state=state,
            )
    _check_units(readings)
    for ohm, change, where in zip(
        readings.resistance, readings.changes(), readings.where, strict=True
    ):
        if abs(change) > _MAX_CHANGE:
            state = "open" if change > 0 else "shorted"
            raise CalibrationError(
                f"{ohm:g} ohm, from {ohm / (1 + change):g} ohm at rest, means that the cord or its"
                f" joints are {state}",
                code="impossible-change",
                where=where,
                action=_REPAIR_ACTION,
                place=where,
                state=state,
            )
    notices = []
    if readings.resistance.max() < _LOW_RESISTANCE_OHM:
        text = (
            f"resistances of at most {readings.resistance.max():g} ohm are low for rubber cord;"
            " check that they are not kohm. The response is the same, since it is relative"
        )
        notices.append(Notice("resistance-low", text))
    if not readings.neutral.any():
        text = "without a neutral cord, effects other than strain cannot be detected"
        notices.append(Notice("no-neutral-cord", text))
    return notices


def _check_units(readings: Readings) -> None:
    """Find kohm among ohm: within a piece by its median, between pieces by their medians."""
    median = {}
    for p in range(len(readings.pieces)):
        indices = np.flatnonzero(readings.piece == p)
        median[p] = float(np.median(readings.resistance[indices])) if len(indices) else np.nan
        for i in indices:
            ratio = readings.resistance[i] / median[p]
            for factor in (_KILO, 1 / _KILO):
                if 0.6 < ratio * factor < 1.7:
                    raise CalibrationError(
                        f"{readings.resistance[i]:g} among readings of about {median[p]:g} of the"
                        " same cord: ohm and kohm are mixed",
                        code="units-mixed",
                        where=readings.where[i],
                        action="Give all resistances in ohm",
                        place=readings.where[i],
                    )
    for p, piece in enumerate(readings.pieces):
        for q, other in enumerate(readings.pieces[:p]):
            ratio = median[p] / median[q]
            if ratio > 0.2 * _KILO or ratio < 5 / _KILO:
                raise CalibrationError(
                    f"the cord {other.name} has about {median[q]:g} ohm and {piece.name} has"
                    f" {median[p]:g}: ohm and kohm are mixed",
                    code="units-mixed",
                    where="readings",
                    action="Give all resistances in ohm",
                    cords=(other.name, piece.name),
                )


@dataclass(frozen=True)
class Drift:
    """Drift of the neutral cords.

    Attributes:
        largest: Largest mean change (R - R0)/R0, with its sign; None without neutral cords.
        at: Piece and the radius, round or trend in which it appears.
        is_significant: Whether it exceeds the limit.
        limit: Change from which a drift is significant.
    """

    largest: float | None
    at: str
    is_significant: bool
    limit: float


def find_drift(readings: Readings, changes: Float, noise: float) -> Drift:
    """Find the most significant drift of the neutral cords.

    Args:
        readings: Readings of all cords.
        changes: Their changes (R - R0)/R0 (n,).
        noise: Standard deviation of a reading of the other cords.

    Returns:
        The drift.
    """
    inside = readings.neutral & ~readings.flat
    outer = ~readings.neutral & ~readings.flat
    min_drift = _MIN_DRIFT_SHARE * float(np.abs(changes[outer]).max(initial=0))
    if not inside.any():
        return Drift(None, "", False, min_drift)
    noise = min(noise, _neutral_noise(readings, changes))
    worst, drift = -1.0, Drift(0.0, "", False, min_drift)
    for at, change, error in _mean_changes(readings, changes, inside):
        limit = max(min_drift, _DRIFT_SIGMAS * noise * error)
        if abs(change) / limit > worst:
            worst = abs(change) / limit
            drift = Drift(change, at, worst > 1, limit)
    return drift


def _mean_changes(
    readings: Readings, changes: Float, inside: Bool
) -> Iterator[tuple[str, float, float]]:
    """Yield mean changes of each neutral piece: at one radius, in one round, and in all.

    The steady rise of the piece from its first to its last reading follows. Each item is a
    description, the change, and its standard error relative to that of one reading.
    """
    for p in np.unique(readings.piece[inside]):
        is_own, name = inside & (readings.piece == p), readings.pieces[p].name
        # R0 is measured once or a few times; its error is in all changes of a piece.
        rest = 1 / (readings.flat & (readings.piece == p)).sum()
        groups = [(f"{name}, all radii", is_own)]
        groups += [
            (f"{name}, {r:g} mm", is_own & (readings.radius == r))
            for r in np.unique(readings.radius[is_own])
        ]
        groups += [
            (f"{name}, round {turn + 1}", is_own & (readings.turn == turn))
            for turn in np.unique(readings.turn[is_own])
        ]
        for at, group in groups:
            yield at, float(changes[group].mean()), float(np.sqrt(1 / group.sum() + rest))
        every = changes[readings.piece == p]
        n = len(every)
        if n >= _MIN_READINGS_FOR_NOISE:
            slope = float(np.polyfit(np.arange(n), every, 1)[0])
            yield (
                f"{name}, from first to last",
                slope * (n - 1),
                np.sqrt(12 * (n - 1) / n / (n + 1)),
            )


def _neutral_noise(readings: Readings, changes: Float) -> float:
    """Return the standard deviation of the neutral cords' readings about a steady drift of each.

    The scatter of the other cords would hide such a drift. The estimate is robust, since a loose
    joint is not noise.
    """
    residuals = []
    for p in np.unique(readings.piece[readings.neutral]):
        own = changes[readings.piece == p]
        if len(own) >= _MIN_READINGS_FOR_NOISE:
            order = np.arange(len(own))
            residuals.append(own - np.polynomial.Polynomial.fit(order, own, 1)(order))
    if not residuals:
        return np.inf
    every = np.concatenate(residuals)
    freedom = len(every) - 2 * len(residuals)
    robust = 1.4826 * float(np.median(np.abs(every))) * np.sqrt(len(every) / freedom)
    return float(max(robust, _MIN_NOISE))


def require_no_drift(drift: Drift) -> None:
    """Check that the neutral cords do not drift.

    Args:
        drift: The most significant drift.

    Raises:
        CalibrationError: The drift is significant.
    """
    if not drift.is_significant or drift.largest is None:
        return
    raise CalibrationError(
        f"changes by {drift.largest:+.2%} ({drift.at}), more than the {drift.limit:.2%} that noise"
        " and a cord slightly off the neutral plane can cause. Other causes are temperature, a"
        " loose joint, and a cord that creeps or is far off that plane",
        code="neutral-cord-drifts",
        where="neutral cord",
        action=(
            'Measure again, or choose the policy "correct" (subtracts the neutral cord\'s change'
            ' from the others, for a drift that all cords share) or "ignore"'
        ),
        change=drift.largest,
        limit=drift.limit,
    )


def correct_drift(readings: Readings) -> Readings:
    """Divide by the changes of the neutral cord of the same specimen, round and jig.

    Args:
        readings: Readings of all cords.

    Returns:
        The corrected readings.

    Raises:
        CalibrationError: There is no reading of a neutral cord for some reading.
    """
    changes = readings.changes()
    resistance = readings.resistance.copy()
    for i in np.flatnonzero(~readings.neutral):
        piece = readings.pieces[readings.piece[i]]
        neutral_pieces = [
            p
            for p, other in enumerate(readings.pieces)
            if other.neutral and (other.specimen, other.source) == (piece.specimen, piece.source)
        ]
        is_neutral = np.isin(readings.piece, neutral_pieces)
        on_same_jig = is_neutral & _is_radius(readings.radius, readings.radius[i])
        in_same_round = on_same_jig & (readings.turn == readings.turn[i])
        selected = in_same_round if in_same_round.any() else on_same_jig
        if not selected.any():
            raise CalibrationError(
                f"there is no reading of a neutral cord of specimen {piece.specimen!r} on the same"
                " jig for the correction",
                code="no-neutral-reading",
                where=readings.where[i],
                action="Add that reading, or choose another policy",
                specimen=piece.specimen,
            )
        resistance[i] /= 1 + float(changes[selected].mean())
    return replace(readings, resistance=resistance)


def _is_radius(radius: Float, value: float) -> Bool:
    return np.isnan(radius) if np.isnan(value) else radius == value


#: Corrections by the policy for a drift of the neutral cord.
POLICIES: dict[str, Callable[[Readings], Readings]] = {
    "refuse": lambda readings: readings,
    "correct": correct_drift,
    "ignore": lambda readings: readings,
}
