"""Whether readings can be what they say: open and shorted cords, units mixed up, missing jigs."""

from __future__ import annotations

import numpy as np

from ..core.errors import CalibrationError
from .readings import LEAST_RADII, Notice, Readings

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
