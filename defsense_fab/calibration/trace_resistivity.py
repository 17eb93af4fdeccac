"""Fit a filament's resistivities and the resistance of pads to a coupon of printed traces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import nnls

from ..core.arrays import Float, Int
from ..core.errors import CalibrationError

PARAMETERS = 3  # along beads, between layers, pad
PADS = 2  # of a trace
#: Probability below which readings are reported as inconsistent: one good coupon in 100.
MIN_PROBABILITY = 0.01
#: Ratio of singular values, of columns of equal length, beyond which numbers are not determined.
_MAX_CONDITION = 1e6
#: Passes of the weights, which follow the predicted resistances; three digits need about five.
_WEIGHT_PASSES = 20


@dataclass(frozen=True)
class CouponTrace:
    """A trace of a coupon, whose resistance is rho (along + k between) and that of two pads.

    Attributes:
        name: Name of the trace.
        along: Length per cross-section that conducts along beads, 1/mm.
        between: Length per cross-section that conducts between layers, 1/mm.
        resistance: Resistance that the filament's table predicts, without pads, ohm.
        is_fitted: Whether its readings are fitted; others are compared with the fit only.
    """

    name: str
    along: float
    between: float
    resistance: float
    is_fitted: bool = True


@dataclass(frozen=True)
class Estimate:
    """A fitted number.

    Attributes:
        value: The number.
        error: Its standard error.
    """

    value: float
    error: float


@dataclass(frozen=True)
class ResistivityFit:
    """Resistivities that a coupon shows.

    Attributes:
        resistivity: Resistivity along beads, ohm mm.
        between_layers: Resistivity between layers, as a multiple of that along beads.
        contact: Resistance of a pad and its connection, ohm.
        fitted: Fitted resistance (n,) of each reading, ohm.
        deviation: Difference (n,) of each reading from it, as a share.
        spread: Standard deviation of a reading by which errors were computed, as a share.
        probability: Probability of deviations as large as these, if readings have the assumed
            spread; None without a reading to spare.
        suspect: Index of the trace whose readings deviate most; None if all are consistent.
    """

    resistivity: Estimate
    between_layers: Estimate
    contact: Estimate
    fitted: Float
    deviation: Float
    spread: float
    probability: float | None
    suspect: int | None


def fit_resistivity(
    traces: Sequence[CouponTrace], trace: Int, resistance: Float, spread: float
) -> ResistivityFit:
    """Fit resistivities and the pads' resistance by relative least squares.

    Resistivities and the pads' resistance are not negative. Standard errors follow from the larger
    of the assumed spread and that of the readings about the fit.

    Args:
        traces: Traces of the coupon.
        trace: Index (n,) of the trace of each reading.
        resistance: Measured resistance (n,) of each reading, ohm.
        spread: Standard deviation of a reading, as a share of it, that printing and meter cause.

    Raises:
        CalibrationError: The traces that were read do not determine the three numbers
            (`too-few-traces`).
    """
    columns = [[t.along, t.between, float(PADS)] for t in traces]
    everything = np.array(columns)[trace]
    is_fitted = np.array([t.is_fitted for t in traces])[trace]
    design, ohm = everything[is_fitted], resistance[is_fitted]
    if len(ohm) < PARAMETERS or _condition(design / ohm[:, None]) > _MAX_CONDITION:
        raise CalibrationError(
            "the measured traces do not determine resistivity, between_layers and contact",
            code="too-few-traces",
            where="readings",
            action="Measure level traces of two lengths and an upright one, at least",
        )
    fitted = ohm
    for _ in range(_WEIGHT_PASSES):
        parameters = _solve(design / fitted[:, None], ohm / fitted)
        fitted = design @ parameters
    if parameters[0] <= 0:
        raise CalibrationError(
            "the readings fit no positive resistivity along beads",
            code="readings-inconsistent",
            where="readings",
            action="Check that each reading belongs to its trace",
        )
    weighted = design / fitted[:, None]
    deviation = ohm / fitted - 1
    free = len(ohm) - PARAMETERS
    square = float(deviation @ deviation)
    measured = float(np.sqrt(square / free)) if free else 0.0
    probability = float(stats.chi2.sf(square / spread**2, free)) if free else None
    used = max(spread, measured)
    covariance = used**2 * np.linalg.inv(weighted.T @ weighted)
    along_value, layers, pad = (float(p) for p in parameters)
    ratio = layers / along_value
    slope = np.array([-ratio, 1.0, 0.0]) / along_value
    errors = np.sqrt(np.diag(covariance))
    is_consistent = probability is None or probability >= MIN_PROBABILITY
    return ResistivityFit(
        Estimate(along_value, float(errors[0])),
        Estimate(ratio, float(np.sqrt(slope @ covariance @ slope))),
        Estimate(pad, float(errors[2])),
        everything @ parameters,
        resistance / (everything @ parameters) - 1,
        used,
        probability,
        None if is_consistent else _find_suspect(weighted, deviation, trace[is_fitted]),
    )


def _condition(design: Float) -> float:
    norm = np.linalg.norm(design, axis=0)
    if not (norm > 0).all():
        return np.inf
    values = np.linalg.svd(design / norm, compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0 else np.inf


def _solve(design: Float, target: Float) -> Float:
    """Return the parameters (3,) of least squares that are not negative."""
    scale = np.linalg.norm(design, axis=0)
    return np.asarray(nnls(design / scale, target)[0] / scale)


def _find_suspect(weighted: Float, deviation: Float, trace: Int) -> int:
    """Return the trace whose readings, left out, reduce the deviations most."""
    numbers = np.unique(trace)
    remaining = []
    for number in numbers:
        kept = trace != number
        ones = 1 + deviation[kept]
        if kept.sum() < PARAMETERS or _condition(weighted[kept]) > _MAX_CONDITION:
            remaining.append(np.inf)
            continue
        rest = ones - weighted[kept] @ _solve(weighted[kept], ones)
        remaining.append(float(rest @ rest))
    return int(numbers[int(np.argmin(remaining))])
