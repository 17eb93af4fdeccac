"""How a cord's resistance answers to strain, as a record: what `response.json` holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from .errors import CalibrationError
from .storage.files import load_json

# Strain of a bar that lies on a rigid jig of known radius (DefSense, CHI 2016, Fig. 3).

#: Of the paper's nine jigs: radii of their surfaces, mm.
RADII = (75.0, 87.5, 100.0, 112.0, 150.0, 175.0, 200.0, 225.0, 250.0)


def bent_strain(radius: float, height: float, thickness: float) -> float:
    """Of a line `height` mm above a jig whose surface has this radius, mm, in a bar of this
    thickness, mm: its neutral plane lies at radius + thickness / 2 and keeps its length."""
    return (height - thickness / 2) / (radius + thickness / 2)


#: Coefficients of each model of w(eps) = (R - R0)/R0; `sensing/response.py` evaluates them.
MODELS: dict[str, tuple[str, ...]] = {
    "line": ("k",),
    "two-slopes": ("tension", "compression"),
    "quadratic": ("k", "q"),
    "cubic": ("k", "q", "c"),
    "piecewise": ("strains", "changes"),
}

#: Of `response.json`.
SCHEMA = 1
_LEAST_KNOTS = 2
_PRIOR = 4  # pieces, that a spread taken for granted counts as much as


@dataclass(frozen=True)
class ResponseSpec:
    """A `model` of MODELS with its `coefficients`, and the `strain_range` (low, high) in which it
    was measured, without unit.

    line: w = k eps. two-slopes: `tension` eps above rest, `compression` eps below. quadratic:
    w = k eps + q eps^2. cubic: with c eps^3, too. piecewise: monotone through the points
    (`strains`, `changes`), (0, 0) among them. Raises CalibrationError for coefficients that are
    missing, not finite or out of order.
    """

    model: str
    coefficients: Mapping[str, Any]
    strain_range: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            self._fail(
                f"unknown model {self.model!r}; there is: {', '.join(MODELS)}", "unknown-model"
            )
        names = MODELS[self.model]
        if set(self.coefficients) != set(names):
            self._fail(
                f"the model {self.model!r} has the coefficients {', '.join(names)}, not"
                f" {', '.join(map(str, self.coefficients)) or 'none'}",
                "wrong-coefficients",
            )
        for name in names:
            try:
                value = np.asarray(self.coefficients[name], float)
            except (TypeError, ValueError):
                self._fail(
                    f"{name} must be numbers, not {self.coefficients[name]!r}", "not-a-number"
                )
            if value.ndim != int(self.model == "piecewise") or not np.isfinite(value).all():
                self._fail(
                    f"{name} must be finite numbers, not {self.coefficients[name]!r}", "not-finite"
                )
        low, high = self.strain_range
        if not low < high:
            self._fail(f"the strain range {low:g} to {high:g} is empty", "empty-range")
        if self.model in ("quadratic", "cubic") and not low <= 0 <= high:
            self._fail(
                f"the strain range {low:g} to {high:g} must have rest (0) in it",
                "rest-outside-range",
            )
        if self.model == "piecewise":
            strains, changes = (np.asarray(self.coefficients[n], float) for n in names)
            if len(strains) != len(changes) or len(strains) < _LEAST_KNOTS:
                self._fail(
                    "strains and changes must be lists of one length, two points or more",
                    "lists-differ",
                )
            if not (np.diff(strains) > 0).all() or not (np.diff(changes) >= 0).all():
                self._fail("strains must rise, and changes must not fall", "not-monotone")
            rest = np.flatnonzero(strains == 0)
            if len(rest) != 1 or changes[rest[0]] != 0:
                self._fail(
                    "at rest (strain 0) the change must be 0; add that point", "rest-not-zero"
                )

    @classmethod
    def line(cls, k: float) -> ResponseSpec:
        """w = k eps, from a data sheet: measured nowhere, taken to hold everywhere."""
        return cls("line", {"k": k})

    def _fail(self, problem: str, code: str) -> NoReturn:
        raise CalibrationError(f"response: {problem}", code=code)

    def to_json(self) -> dict[str, Any]:
        """The part of `response.json` that `read_response` reads."""
        plain = {
            name: np.asarray(value, float).tolist() for name, value in self.coefficients.items()
        }
        return {
            "model": self.model,
            "coefficients": plain,
            "strain_range": list(self.strain_range),
        }


@dataclass(frozen=True)
class MeasuredResponse:
    """What `defsense calibrate fit` found of a cord, by the `file` it is in: the slope `k_res` at
    rest with its 95 % `interval`, and the standard deviation `spread` of a piece's gain, that of
    the pieces measured pooled with the one that was taken for granted."""

    file: str
    k_res: float
    interval: tuple[float, float]
    spread: float


def read_measured(path: Path) -> MeasuredResponse | None:
    """Of `response.json`; None of one that was written by hand, without doubts. Raises
    CalibrationError."""
    data = load_json(path, CalibrationError, "'defsense calibrate fit' writes such a file")
    if not {"k_res", "interval", "doubt", "pieces"} <= set(data):
        return None
    try:
        low, high = (float(x) for x in data["interval"])
        gains = np.array([float(p["gain"]) for p in data["pieces"]])
        assumed, k_res = float(data["doubt"]["spread_assumed"]), float(data["k_res"])
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(
            f"{path}: not a response as 'defsense calibrate fit' writes it: {error!r}",
            code="bad-response-file",
        ) from None
    own = float(((gains - gains.mean()) ** 2).sum()) if len(gains) else 0.0
    free = _PRIOR + max(len(gains) - 1, 0)
    spread = float(np.sqrt((_PRIOR * assumed**2 + own) / free))
    return MeasuredResponse(path.name, k_res, (low, high), spread)


def read_response(path: Path) -> ResponseSpec:
    """Of `response.json`, as `defsense calibrate fit` writes it. Raises CalibrationError."""
    data = load_json(path, CalibrationError, "'defsense calibrate fit' writes such a file")
    try:
        if data["schema"] != SCHEMA:
            raise CalibrationError(
                f"this version reads schema {SCHEMA}, not {data['schema']!r}", code="wrong-schema"
            )
        low, high = (float(n) for n in data["strain_range"])
        return ResponseSpec(data["model"], dict(data["coefficients"]), (low, high))
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}", code=error.code, **error.data) from None
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(
            f"{path}: not a response as 'defsense calibrate fit' writes it: {error!r}",
            code="bad-response-file",
        ) from None
