"""The cord in the neutral plane: it must not answer; where it does, something else is at work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..core.arrays import Bool, Float
from ..core.errors import CalibrationError
from .readings import LEAST_RADII, Notice, Readings

# Whether readings can be what they say: open and shorted cords, units mixed up, missing jigs.

#: A cord on a jig changes by a tenth or two; by more than this it is broken or shorted.
_MOST_CHANGE = 0.8
#: kohm among ohm, or the other way round.
_THOUSAND = 1000.0
#: Below, ohm: pieces of 100 mm and more of any rubber cord have far more.
_FEW_OHMS = 20.0


def check(readings: Readings) -> list[Notice]:
    """Raises CalibrationError with the place of the first reading that cannot be; returns
    warnings."""
    outer = readings.only(~readings.neutral)
    if len(outer.radii) < LEAST_RADII:
        have = ", ".join(f"{r:g}" for r in outer.radii) or "none"
        raise CalibrationError(
            f"{len(outer.radii)} different jig radii ({have}): a response needs at least"
            f" {LEAST_RADII}; measure on more jigs",
            code="too-few-radii",
            count=len(outer.radii),
        )
    for i, where in enumerate(readings.where):
        ohm = readings.resistance[i]
        if not (np.isfinite(ohm) and ohm > 0):
            raise CalibrationError(
                f"{where}: a resistance of {ohm:g} ohm: the cord or its joints are"
                f" {'shorted' if ohm == 0 else 'open'}; mend it and measure again, or leave the row"
                " out",
                code="impossible-resistance",
                place=where,
                state="shorted" if ohm == 0 else "open",
            )
    _check_units(readings)
    changes = readings.changes()
    for i, where in enumerate(readings.where):
        if abs(changes[i]) > _MOST_CHANGE:
            rest = readings.resistance[i] / (1 + changes[i])
            state = "open" if changes[i] > 0 else "shorted"
            raise CalibrationError(
                f"{where}: {readings.resistance[i]:g} ohm against {rest:g} at rest cannot be"
                f" strain: the cord or its joints are {state}; mend it and measure again, or leave"
                " the row out",
                code="impossible-change",
                place=where,
                state=state,
            )
    warnings = []
    if readings.resistance.max() < _FEW_OHMS:
        text = (
            f"resistances of at most {readings.resistance.max():g} ohm are little for rubber cord:"
            " were they kohm? The response is the same, for it is relative"
        )
        warnings.append(Notice("resistance-low", text))
    if not readings.neutral.any():
        text = (
            "there is no neutral cord: whether something else than strain is at work is not known"
        )
        warnings.append(Notice("no-neutral-cord", text))
    return warnings


def _check_units(readings: Readings) -> None:
    """kohm among ohm: within a piece by its median, between pieces by their medians."""
    middle = {}
    for p in range(len(readings.pieces)):
        own = np.flatnonzero(readings.piece == p)
        middle[p] = float(np.median(readings.resistance[own])) if len(own) else np.nan
        for i in own:
            ratio = readings.resistance[i] / middle[p]
            for factor in (_THOUSAND, 1 / _THOUSAND):
                if 0.6 < ratio * factor < 1.7:
                    raise CalibrationError(
                        f"{readings.where[i]}: {readings.resistance[i]:g} among readings of about"
                        f" {middle[p]:g} of the same cord: ohm and kohm are mixed; give ohm",
                        code="units-mixed",
                        place=readings.where[i],
                    )
    for p, one in enumerate(readings.pieces):
        for q, other in enumerate(readings.pieces[:p]):
            ratio = middle[p] / middle[q]
            if ratio > 0.2 * _THOUSAND or ratio < 5 / _THOUSAND:
                raise CalibrationError(
                    f"about {middle[q]:g} ohm in the cord {other.name} and {middle[p]:g} in"
                    f" {one.name}: ohm and kohm are mixed; give ohm",
                    code="units-mixed",
                    cords=(other.name, one.name),
                )


Policy = Literal["refuse", "correct", "ignore"]

#: A drift matters from this fraction of the outer cords' largest change on,
_MATTERS = 0.05
#: if it is so many standard errors of the mean that it shows in.
_CLEAR = 5.0
_LEAST_NOISE = 1e-5
_FEW = 5  # readings that tell no noise


@dataclass(frozen=True)
class Drift:
    """`largest` mean change (R - R0)/R0 of the neutral cords, with its sign, over the readings
    `at` one radius, in one round or of one piece, or its rise from first to last; None without
    neutral cords. Whether it is `bad`, and the `limit` from which on it would be."""

    largest: float | None
    at: str
    bad: bool
    limit: float


def drift(readings: Readings, changes: Float, noise: float) -> Drift:
    """Of the neutral cords in `changes` (n,); `noise` is the standard deviation of a reading of the
    others."""
    inside = readings.neutral & ~readings.flat
    outer = ~readings.neutral & ~readings.flat
    matters = _MATTERS * float(np.abs(changes[outer]).max(initial=0))
    if not inside.any():
        return Drift(None, "", False, matters)
    noise = min(noise, _own_noise(readings, changes))
    worst, found = -1.0, Drift(0.0, "", False, matters)
    for at, change, error in _looks(readings, changes, inside):
        limit = max(matters, _CLEAR * noise * error)
        if abs(change) / limit > worst:
            worst = abs(change) / limit
            found = Drift(change, at, worst > 1, limit)
    return found


def _looks(readings: Readings, changes: Float, inside: Bool) -> Iterator[tuple[str, float, float]]:
    """Where the readings are, their change, and its standard error in that of one reading: the
    means of each piece at one radius, in one round and in all, and its steady rise from first to
    last."""
    for p in np.unique(readings.piece[inside]):
        own, name = inside & (readings.piece == p), readings.pieces[p].name
        # R0 is measured, too, once or a few times: its error is in all changes of a piece.
        rest = 1 / (readings.flat & (readings.piece == p)).sum()
        groups = [(f"{name}, all radii", own)]
        groups += [(f"{name}, {r:g} mm", own & (readings.radius == r))
                   for r in np.unique(readings.radius[own])]  # fmt: skip
        groups += [(f"{name}, round {turn + 1}", own & (readings.turn == turn))
                   for turn in np.unique(readings.turn[own])]  # fmt: skip
        for at, group in groups:
            yield at, float(changes[group].mean()), float(np.sqrt(1 / group.sum() + rest))
        every = changes[readings.piece == p]
        n = len(every)
        if n >= _FEW:
            slope = float(np.polyfit(np.arange(n), every, 1)[0])
            yield (
                f"{name}, from first to last",
                slope * (n - 1),
                np.sqrt(12 * (n - 1) / n / (n + 1)),
            )


def _own_noise(readings: Readings, changes: Float) -> float:
    """Standard deviation of the neutral cords' readings about a steady drift of each, which the
    scatter of the other cords would hide behind; robust, for a loose joint is no noise."""
    left = []
    for p in np.unique(readings.piece[readings.neutral]):
        own = changes[readings.piece == p]
        if len(own) >= _FEW:
            order = np.arange(len(own))
            left.append(own - np.polynomial.Polynomial.fit(order, own, 1)(order))
    if not left:
        return np.inf
    every = np.concatenate(left)
    free = len(every) - 2 * len(left)
    robust = 1.4826 * float(np.median(np.abs(every))) * np.sqrt(len(every) / free)
    return float(max(robust, _LEAST_NOISE))


def refuse(found: Drift) -> None:
    """Raises CalibrationError if the drift is bad."""
    if not found.bad or found.largest is None:
        return
    raise CalibrationError(
        f"the neutral cord changes by {found.largest:+.2%} ({found.at}), more than the"
        f" {found.limit:.2%} that noise and a cord a little off its place could do: something else"
        " than strain is at work (temperature, a loose joint, a cord that creeps or lies off the"
        " neutral plane). Measure again, or choose --neutral correct (takes the neutral cord's"
        " change from the others: right for a common drift) or --neutral ignore",
        code="neutral-cord-drifts",
        change=found.largest,
        limit=found.limit,
    )


def corrected(readings: Readings) -> Readings:
    """Without what the neutral cord of the same specimen did in the same round on the same jig, as
    a common factor.

    Raises CalibrationError where there is none to go by.
    """
    changes = readings.changes()
    resistance = readings.resistance.copy()
    for i in np.flatnonzero(~readings.neutral):
        piece = readings.pieces[readings.piece[i]]
        specimen = piece.specimen
        own = [
            p
            for p, one in enumerate(readings.pieces)
            if one.neutral and (one.specimen, one.source) == (specimen, piece.source)
        ]
        beside = np.isin(readings.piece, own)
        same = beside & _same(readings.radius, readings.radius[i])
        best = same & (readings.turn == readings.turn[i])
        found = best if best.any() else same
        if not found.any():
            raise CalibrationError(
                f"{readings.where[i]}: no reading of a neutral cord of specimen {specimen!r} on the"
                " same jig to correct it by",
                code="no-neutral-reading",
                specimen=specimen,
            )
        resistance[i] /= 1 + float(changes[found].mean())
    return replace(readings, resistance=resistance)


def _same(radius: Float, one: float) -> Bool:
    return np.isnan(radius) if np.isnan(one) else radius == one


POLICIES: dict[str, Callable[[Readings], Readings]] = {
    "refuse": lambda readings: readings,
    "correct": corrected,
    "ignore": lambda readings: readings,
}
