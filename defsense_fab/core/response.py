"""Response of a cord's resistance to strain: the jigs that strain it, and `response.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np

from .arrays import Float
from .errors import CalibrationError
from .storage.files import load_json

#: Sizes of the bending specimen in DefSense (CHI 2016, Fig. 3), mm.
SPECIMEN_LENGTH_MM, SPECIMEN_THICKNESS_MM, SPECIMEN_WIDTH_MM = 150.0, 15.0, 20.0
#: Distance of the outer cords from its bottom and top, mm.
CORD_OFFSET_MM = 2.0
#: Radii of the surfaces of its nine jigs, mm.
JIG_RADII_MM = (75.0, 87.5, 100.0, 112.0, 150.0, 175.0, 200.0, 225.0, 250.0)

#: Models of w(eps) = (R - R0)/R0.
ModelName = Literal["line", "two-slopes", "quadratic", "cubic", "piecewise"]
#: Coefficients of each model; `sensing/response.py` evaluates them.
MODELS: dict[str, tuple[str, ...]] = {
    "line": ("k",),
    "two-slopes": ("tension", "compression"),
    "quadratic": ("k", "q"),
    "cubic": ("k", "q", "c"),
    "piecewise": ("strains", "changes"),
}

#: Schema of `response.json`.
SCHEMA = 1
_MIN_KNOTS = 2
_ASSUMED_SPREAD_PIECES = 4  # number of measured pieces that the assumed spread counts for
_FIT_ACTION = "Write it with 'defsense calibrate fit'"


def bent_strain(radius: float, height: float, thickness: float) -> float:
    """Return the strain along a line in a bar that is bent over a rigid jig.

    The neutral plane of the bar is at radius + thickness / 2 and keeps its length.

    Args:
        radius: Radius of the jig's surface, mm.
        height: Height of the line above the jig's surface, mm.
        thickness: Thickness of the bar, mm.

    Returns:
        The strain, positive in tension.

    References:
        DefSense, CHI 2016, Fig. 3.
    """
    return (height - thickness / 2) / (radius + thickness / 2)


@dataclass(frozen=True)
class ResponseSpec:
    """Model of w(eps) = (R - R0)/R0 with its coefficients.

    The models are:
        line: w = k eps.
        two-slopes: w = `tension` eps above rest, w = `compression` eps below.
        quadratic: w = k eps + q eps^2.
        cubic: w = k eps + q eps^2 + c eps^3.
        piecewise: monotone through the points (`strains`, `changes`), which include (0, 0).

    Attributes:
        model: A name in `MODELS`.
        coefficients: The model's coefficients by name.
        strain_range: Lowest and highest strain at which the response was measured.

    Raises:
        CalibrationError: Coefficients are missing, not finite or out of order.
    """

    model: str
    coefficients: Mapping[str, Any]
    strain_range: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            self._fail(
                f"unknown model {self.model!r}", "unknown-model", f"Choose {', '.join(MODELS)}"
            )
        names = MODELS[self.model]
        if set(self.coefficients) != set(names):
            given = ", ".join(map(str, self.coefficients)) or "none"
            self._fail(
                f"the model {self.model!r} has the coefficients {given}",
                "wrong-coefficients",
                f"Give {', '.join(names)}",
            )
        for name in names:
            given = self.coefficients[name]
            try:
                value = np.asarray(given, float)
            except (TypeError, ValueError):
                self._fail(f"{name} is {given!r}", "not-a-number", "Give numbers")
            if value.ndim != int(self.model == "piecewise") or not np.isfinite(value).all():
                self._fail(f"{name} is {given!r}", "not-finite", "Give finite numbers")
        low, high = self.strain_range
        if not low < high:
            self._fail(
                f"the strain range {low:g} to {high:g} is empty",
                "empty-range",
                "Give the lower strain first",
            )
        if self.model in ("quadratic", "cubic") and not low <= 0 <= high:
            self._fail(
                f"the strain range {low:g} to {high:g} does not include rest",
                "rest-outside-range",
                "Give a range that includes 0",
            )
        if self.model == "piecewise":
            self._check_points(*(np.asarray(self.coefficients[n], float) for n in names))

    def _check_points(self, strains: Float, changes: Float) -> None:
        if len(strains) != len(changes) or len(strains) < _MIN_KNOTS:
            self._fail(
                f"there are {len(strains)} strains and {len(changes)} changes",
                "lists-differ",
                f"Give as many strains as changes, at least {_MIN_KNOTS}",
            )
        rises = np.diff(changes)
        if not (np.diff(strains) > 0).all() or not ((rises >= 0).all() or (rises <= 0).all()):
            self._fail(
                "strains do not increase, or changes both increase and decrease",
                "not-monotone",
                "Sort the points by strain, or use the model cubic for a response that turns",
            )
        rest = np.flatnonzero(strains == 0)
        if len(rest) != 1 or changes[rest[0]] != 0:
            self._fail(
                "there is no change of 0 at a strain of 0", "rest-not-zero", "Add the point (0, 0)"
            )

    @classmethod
    def line(cls, k: float) -> ResponseSpec:
        """Create w = k eps from a data sheet: not measured, and assumed at all strains."""
        return cls("line", {"k": k})

    def _fail(self, problem: str, code: str, action: str) -> NoReturn:
        raise CalibrationError(problem, code=code, where="response", action=action)

    def to_json(self) -> dict[str, Any]:
        """Return the part of `response.json` that `read_response` reads."""
        coefficients = {
            name: np.asarray(value, float).tolist() for name, value in self.coefficients.items()
        }
        return {
            "model": self.model,
            "coefficients": coefficients,
            "strain_range": list(self.strain_range),
        }


@dataclass(frozen=True)
class MeasuredResponse:
    """What a calibration says about the slope of a cord's response.

    Attributes:
        file: Name of the file.
        k_res: Slope at rest.
        interval: 95 % interval of the slope at rest.
        spread: Standard deviation of the gains of pieces: that of the measured pieces, pooled with
            the assumed one.
    """

    file: str
    k_res: float
    interval: tuple[float, float]
    spread: float


def read_measured(path: Path) -> MeasuredResponse | None:
    """Read the uncertainty of a response.

    Args:
        path: A `response.json`.

    Returns:
        The uncertainty; None for a file written by hand, which has none.

    Raises:
        CalibrationError: The file cannot be read or is invalid.
    """
    data = load_json(path, CalibrationError, _FIT_ACTION)
    if not {"k_res", "interval", "doubt", "pieces"} <= set(data):
        return None
    try:
        low, high = (float(x) for x in data["interval"])
        gains = np.array([float(p["gain"]) for p in data["pieces"]])
        assumed, k_res = float(data["doubt"]["spread_assumed"]), float(data["k_res"])
    except (KeyError, TypeError, ValueError) as error:
        raise _bad_file(path, error) from None
    squares = float(((gains - gains.mean()) ** 2).sum()) if len(gains) else 0.0
    freedom = _ASSUMED_SPREAD_PIECES + max(len(gains) - 1, 0)
    spread = float(np.sqrt((_ASSUMED_SPREAD_PIECES * assumed**2 + squares) / freedom))
    return MeasuredResponse(path.name, k_res, (low, high), spread)


def read_response(path: Path) -> ResponseSpec:
    """Read `response.json`.

    Args:
        path: The file.

    Returns:
        The response.

    Raises:
        CalibrationError: The file cannot be read or is invalid.
    """
    data = load_json(path, CalibrationError, _FIT_ACTION)
    try:
        if data["schema"] != SCHEMA:
            raise CalibrationError(
                f"has the schema {data['schema']!r}; this version reads {SCHEMA}",
                code="wrong-schema",
                action=_FIT_ACTION,
            )
        low, high = (float(n) for n in data["strain_range"])
        return ResponseSpec(data["model"], dict(data["coefficients"]), (low, high))
    except CalibrationError as error:
        raise CalibrationError(
            error.problem, code=error.code, where=path, action=error.action, **error.data
        ) from None
    except (KeyError, TypeError, ValueError) as error:
        raise _bad_file(path, error) from None


def _bad_file(path: Path, error: Exception) -> CalibrationError:
    return CalibrationError(
        f"is not a response ({error!r})",
        code="response-file-invalid",
        where=path,
        action=_FIT_ACTION,
    )
