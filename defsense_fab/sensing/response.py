"""Signals of cords: the response w(eps) = (R - R0)/R0 to strain, and its mean along a cord.

Every model of `core/response.py` becomes a piecewise cubic, so that the optimizer's loops only need
to evaluate one form. Outside of the measured strains a model continues along its tangent, because a
polynomial could turn around there.

The strain of a segment is eps = |x'_{k+1} - x'_k| / |x_{k+1} - x_k| - 1 with x' = x + u(x). The
signal of a cord that follows the body is the mean of w(eps) over the rest length (DefSense, CHI
2016, Eqs. 1-3, with the length of the deformed polyline in place of F at the midpoints).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..core.machine import kernels
from ..core.response import ResponseSpec


@dataclass(frozen=True)
class Response:
    """Piecewise cubic response w(eps) = sum_j pieces[i, j] (eps - origins[i])^j.

    Piece i is between breaks i - 1 and i.

    Attributes:
        breaks: Strains (b,), increasing.
        origins: Origin of each piece (b + 1,).
        pieces: Coefficients of each piece (b + 1, 4).
    """

    breaks: Float
    origins: Float
    pieces: Float

    @classmethod
    def line(cls, k: float) -> Response:
        """Create w = k eps, the paper's response, whose k is its k_res (the gauge factor)."""
        return cls(np.zeros(0), np.zeros(1), np.array([[0.0, k, 0.0, 0.0]]))

    @property
    def linear_slope(self) -> float | None:
        """Slope of a line through the origin; None for any other response."""
        is_line = not len(self.breaks) and not self.pieces[0, [0, 2, 3]].any()
        return float(self.pieces[0, 1]) if is_line else None

    def __call__(self, strain: Float) -> Float:
        """Return w at strains (...)."""
        return self._evaluate(strain)[0]

    def slope(self, strain: Float) -> Float:
        """Return dw/deps at strains (...)."""
        return self._evaluate(strain)[1]

    def _evaluate(self, strain: Float) -> tuple[Float, Float]:
        strain = np.asarray(strain, float)
        out = np.empty((2, strain.size))
        kernels.evaluate_response(np.ravel(strain), self.breaks, self.origins, self.pieces, out)
        w, slope = out.reshape(2, *strain.shape)
        return w, slope


def build_response(spec: ResponseSpec) -> Response:
    """Convert the record of a response to a function of strain."""
    builders = {
        "line": _build_line,
        "two-slopes": _build_two_slopes,
        "piecewise": _build_piecewise,
    }
    return builders.get(spec.model, _build_polynomial)(spec)


def _build_line(spec: ResponseSpec) -> Response:
    return Response.line(float(spec.coefficients["k"]))


def _build_two_slopes(spec: ResponseSpec) -> Response:
    slopes = [spec.coefficients["compression"], spec.coefficients["tension"]]
    return Response(np.zeros(1), np.zeros(2), np.array([[0.0, s, 0.0, 0.0] for s in slopes]))


def _build_polynomial(spec: ResponseSpec) -> Response:
    k, q, c = (float(spec.coefficients.get(n, 0.0)) for n in ("k", "q", "c"))
    inside = Response(np.zeros(0), np.zeros(1), np.array([[0.0, k, q, c]]))
    return _add_tangents(inside, *spec.strain_range)


def _build_piecewise(spec: ResponseSpec) -> Response:
    # Fritsch & Butland 1984: the interpolant of monotone data is monotone.
    from scipy.interpolate import PchipInterpolator

    x, y = (np.asarray(spec.coefficients[n], float) for n in ("strains", "changes"))
    pieces = PchipInterpolator(x, y).c[::-1].T
    inside = Response(x[1:-1], x[:-1], np.ascontiguousarray(pieces))
    return _add_tangents(inside, float(x[0]), float(x[-1]))


def _add_tangents(inside: Response, low: float, high: float) -> Response:
    """Return a response between two strains, continued along its tangents outside."""
    breaks, origins, pieces = inside.breaks, inside.origins, inside.pieces
    if np.isfinite(low):
        tail = [float(inside(np.array(low))), float(inside.slope(np.array(low))), 0.0, 0.0]
        breaks, origins = np.append(low, breaks), np.append(low, origins)
        pieces = np.concatenate([[tail], pieces])
    if np.isfinite(high):
        tail = [float(inside(np.array(high))), float(inside.slope(np.array(high))), 0.0, 0.0]
        breaks, origins = np.append(breaks, high), np.append(origins, high)
        pieces = np.concatenate([pieces, [tail]])
    return Response(breaks, origins, pieces)


def cord_signals(
    rest: Float, deformed: Float, response: Response, resistance: Float | None = None
) -> Float:
    """Return the signals of cords that follow the body.

    Args:
        rest: Polylines (..., p, 3) at rest, mm.
        deformed: The same in each state (s, ..., p, 3), mm.
        response: Response to strain.
        resistance: Resistances (..., p - 1) of the segments per length, in any unit; equal by
            default.

    Returns:
        (R - R0)/R0 (s, ...).
    """
    before, after = (np.linalg.norm(np.diff(x, axis=-2), axis=-1) for x in (rest, deformed))
    length = before.sum(-1)
    slope = response.linear_slope
    if resistance is not None:
        weight = before * resistance
        strain = after / np.maximum(before, 1e-300) - 1
        return np.asarray((weight * response(strain)).sum(-1) / weight.sum(-1))
    if slope is not None:  # only the total length matters
        return np.asarray(slope * (after.sum(-1) / length - 1))
    before = np.maximum(before, 1e-300)  # a segment without length has no weight
    return np.asarray((before * response(after / before - 1)).sum(-1) / length)


def relative_change(resistance: Float, rest: Float) -> Float:
    """Return (R - R0)/R0.

    Args:
        resistance: Measured resistances (..., c), ohm.
        rest: Resistances at rest, of a shape that broadcasts to the former, ohm.

    Returns:
        Relative changes (..., c); NaN where either is NaN, inf for an open circuit.
    """
    return np.asarray(resistance / rest - 1)


def mean_strain(rest: Float, deformed: Float) -> Float:
    """Return the relative change in length of polylines.

    Args:
        rest: Polylines (..., p, 3) at rest, mm.
        deformed: The same in each state (s, ..., p, 3), mm.

    Returns:
        Strains (s, ...).
    """
    before, after = (np.linalg.norm(np.diff(x, axis=-2), axis=-1) for x in (rest, deformed))
    return np.asarray(after.sum(-1) / before.sum(-1) - 1)


def segment_strain_range(rest: Float, deformed: Float) -> tuple[float, float]:
    """Return the lowest and highest strain of any segment of a polyline in any state.

    Args:
        rest: Polyline (p, 3) at rest, mm.
        deformed: The same in each state (s, p, 3), mm.
    """
    length = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    strain = np.linalg.norm(np.diff(deformed, axis=1), axis=2) / length - 1
    return float(strain.min()), float(strain.max())
