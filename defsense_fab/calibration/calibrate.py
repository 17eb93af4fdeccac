"""From readings to a response with its doubt: the one entry of this folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Float, Int
from ..core.errors import CalibrationError
from ..core.response import ResponseSpec
from ..sensing.response import relative_change
from . import reading_checks
from .interval import Doubt, doubt
from .model_selection import Tried, alike, choose, compare
from .reading_checks import Drift, Policy, check
from .readings import Notice, Piece, Readings
from .response_fit import Data, Fitted, free_gains

#: Standard deviation between specimens that is taken for granted until there are many; between
#: pieces of one cord likewise.
SPREAD = 0.03
_DRIFT_CODES = {"correct": "drift-corrected", "ignore": "drift-ignored"}
_MINUTE = 0.05  # k_res: below, nothing answers
_WIDE = 0.25
_OTHER = 1.1  # R0 of one piece at two times: more is another piece


@dataclass(frozen=True)
class Calibration:
    """The response and all that tells how far to trust it.

    `data` are the readings of outer cords as fitted, `readings` those readings, `pieces` their
    pieces with their gains (pieces,), `tried` the models, `reason` why this one, `drift` of the
    neutral cord, `neutral_changes` (m,) on the radii `neutral_radius` (m,), warnings.
    """

    response: ResponseSpec
    k_res: float
    doubt: Doubt
    reason: str
    tried: Mapping[str, Tried]
    data: Data
    readings: Readings
    pieces: tuple[Piece, ...]
    gains: Float
    drift: Drift
    neutral_changes: Float
    neutral_radius: Float
    noise: float
    warnings: tuple[Notice, ...]


def calibrate(
    readings: Readings,
    *,
    policy: Policy = "refuse",
    model: str | None = None,
    spread: float = SPREAD,
    rng: np.random.Generator | None = None,
    draws: int | None = None,
) -> Calibration:
    """The response of the cord in these specimens; `model` overrules the choice.

    Raises CalibrationError for readings that cannot be, too few radii, and a neutral cord that
    drifts where `policy` is to refuse it.
    """
    warnings = check(readings)
    changes = readings.changes()
    noise = _first_fit(*_outer(readings, changes), spread).noise
    drifting = reading_checks.drift(readings, changes, noise)
    if policy == "refuse":
        reading_checks.refuse(drifting)
    elif drifting.bad and drifting.largest is not None:
        done = "taken from the other cords" if policy == "correct" else "ignored, as you asked"
        text = f"the neutral cord changes by {drifting.largest:+.2%} ({drifting.at}): {done}"
        warnings.append(Notice(_DRIFT_CODES[policy], text))
    used = reading_checks.POLICIES[policy](readings)
    outer = used.only(~used.neutral)
    data, radius = _outer(used, used.changes())
    # Flat readings remember, too: R0 is what they tell of a piece that forgot.
    rest = 1 + _first_fit(data, radius, spread).offset[data.piece]
    data = replace(data, y=relative_change(1 + data.y, rest))
    tried = compare(data, radius, spread)
    both = _both_faces(data)
    chosen, reason = choose(tried, both)
    if model is not None and model not in tried:
        raise CalibrationError(
            f"--model {model}: needs more radii than the {len(outer.radii)} that were measured;"
            f" there is: {', '.join(tried)}",
            code="too-few-radii",
            model=model,
            count=len(outer.radii),
        )
    if model is not None:
        chosen, reason = model, f"{model}: as you asked; by itself {reason}"
    fitted = tried[chosen].fitted
    names = [(p.specimen, p.place) for p in outer.pieces]
    rng = rng or np.random.default_rng(1)
    extra = {} if draws is None else {"draws": draws}
    others = alike(tried, chosen, both)
    doubted = doubt(data, fitted, others, names, outer.turn, spread, rng, **extra)
    strains = (float(data.strain.min()), float(data.strain.max()))
    gains = free_gains(data, fitted)
    k_res = fitted.model.slope_at_rest(fitted.theta)
    inside = readings.neutral & ~readings.flat
    return Calibration(
        fitted.model.spec(fitted.theta, strains),
        k_res,
        doubted,
        reason,
        tried,
        data,
        outer,
        outer.pieces,
        gains,
        drifting,
        changes[inside],
        readings.radius[inside],
        fitted.noise,
        (*warnings, *_warnings(k_res, doubted, outer, gains, data, fitted)),
    )


def _outer(readings: Readings, changes: Float) -> tuple[Data, Float]:
    """Readings of the outer cords for fitting, and their radii."""
    keep = ~readings.neutral
    strain = readings.strain[keep]
    data = Data(
        changes[keep],
        strain,
        readings.piece[keep],
        len(readings.pieces),
        readings.memory[keep],
    )
    return data, readings.radius[keep]


def _first_fit(data: Data, radius: Float, spread: float) -> Fitted:
    """For R0 and the noise."""
    tried = compare(data, radius, spread)
    return tried[choose(tried, _both_faces(data))[0]].fitted


def _warnings(
    k_res: float, doubted: Doubt, outer: Readings, gains: Float, data: Data, fitted: Fitted
) -> list[Notice]:
    out: list[Notice] = []

    def add(code: str, text: str) -> None:
        out.append(Notice(code, text))

    low, high = doubted.interval
    if k_res < 0:
        add(
            "resistance-falls",
            f"resistances fall where the cord is stretched (k_res {k_res:.2f}): were top and bottom"
            " exchanged? The bottom cord lies on the jig",
        )
    elif low < _MINUTE:
        add(
            "response-insignificant",
            f"k_res {k_res:.2f} is hardly told from nothing: does the cord answer at all?",
        )
    strain = np.linspace(data.strain.min(), data.strain.max(), 200)
    falls = np.diff(fitted.model.predict(fitted.theta, strain)) * np.sign(k_res) < 0
    if falls.any():
        turn = float(np.abs(strain[:-1][falls]).min())
        add(
            "response-not-monotone",
            f"the response turns round (near a strain of {turn:.1%}): one resistance then stands"
            " for two strains; --model line or piecewise keep it monotone",
        )
    if high - low > 2 * _WIDE * abs(k_res):
        add(
            "interval-wide",
            f"k_res is only known within {low:.2f} to {high:.2f}; more rounds, or more specimens,"
            " narrow that",
        )
    for p, gain in enumerate(gains):
        if np.isfinite(gain) and abs(gain - 1) > 0.2:
            add(
                "gain-unusual",
                f"the cord {outer.pieces[p].name} answers {gain:.2f} times as much as the mean of"
                " all: look at its joints, and whether it lies where it should",
            )
    rest = outer.resistance / (1 + outer.changes())
    for one in {(p.specimen, p.place) for p in outer.pieces}:
        own = [k for k, p in enumerate(outer.pieces) if (p.specimen, p.place) == one]
        found = rest[np.isin(outer.piece, own)]
        if len(found) and found.max() > _OTHER * found.min():
            add(
                "rest-differs",
                f"the {one[1]} cord of specimen {one[0]!r} has {found.min():.0f} ohm at rest in one"
                f" source and {found.max():.0f} in another: if these are two specimens, give them"
                " two names (record --name), for they then count as two",
            )
    if not _both_faces(data):
        add(
            "one-face-only",
            "every piece was only stretched or only pressed: a difference between the two cannot be"
            " told from one between pieces; turn the specimen over for some rounds (column face)",
        )
    return out


def _both_faces(data: Data) -> bool:
    strained: Int = np.sign(np.round(data.strain, 9)).astype(int)
    return any({-1, 1} <= set(strained[data.piece == p].tolist()) for p in np.unique(data.piece))
