"""The cord's response w(eps) = (R - R0)/R0 to strain, with its derivative.

Every model of `core/response.py` becomes a piecewise cubic, so that the loops of the optimiser need
to know only one. Outside of the strains in which it was measured a model goes on along its tangent:
a polynomial would turn round there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..core.machine.compiled import compiled
from ..core.response import ResponseSpec

# The cord's signal: relative change of resistance, measured or along a deformed polyline.
#
# A segment's strain is eps = |x'_{k+1} - x'_k| / |x_{k+1} - x_k| - 1 with x' = x + u(x), and the
# signal of a cord that follows it is the mean over the rest length of the response w(eps).
# (DefSense, CHI 2016, Eqs. 1-3, with the length of the deformed polyline in place of F at the
# midpoints.)


def signals(rest: Float, deformed: Float, response: Response) -> Float:
    """(R - R0)/R0 of cords in states.

    `rest` (..., p, 3) mm; `deformed` (s, ..., p, 3) mm. Returns (s, ...).
    """
    before, after = (np.linalg.norm(np.diff(x, axis=-2), axis=-1) for x in (rest, deformed))
    length = before.sum(-1)
    slope = response.slope_everywhere
    if slope is not None:  # the length alone counts
        return np.asarray(slope * (after.sum(-1) / length - 1))
    before = np.maximum(before, 1e-300)  # a segment without length answers to nothing
    return np.asarray((before * response(after / before - 1)).sum(-1) / length)


def relative_change(resistance: Float, rest: Float) -> Float:
    """(R - R0)/R0, without unit.

    `resistance` (..., c) ohm as measured; `rest` ohm at rest, of a shape that broadcasts to it.
    Returns (..., c): NaN where either is, inf for an open circuit.
    """
    return np.asarray(resistance / rest - 1)


def mean_strain(rest: Float, deformed: Float) -> Float:
    """Relative change of length (s, ...) of polylines: `rest` (..., p, 3) mm, `deformed`
    (s, ..., p, 3) mm."""
    before, after = (np.linalg.norm(np.diff(x, axis=-2), axis=-1) for x in (rest, deformed))
    return np.asarray(after.sum(-1) / before.sum(-1) - 1)


def strain_range(rest: Float, deformed: Float) -> tuple[float, float]:
    """Least and greatest strain of any segment in any state: rest (p, 3), deformed (s, p, 3)."""
    length = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    strain = np.linalg.norm(np.diff(deformed, axis=1), axis=2) / length - 1
    return float(strain.min()), float(strain.max())


@dataclass(frozen=True)
class Response:
    """w(eps) = sum_j pieces[i, j] (eps - origins[i])^j, piece i lying between breaks i - 1 and i:
    `breaks` (b,) rising, `origins` (b + 1,), `pieces` (b + 1, 4)."""

    breaks: Float
    origins: Float
    pieces: Float

    @classmethod
    def line(cls, k: float) -> Response:
        """w = k eps: the paper's (k is its k_res, the gauge factor)."""
        return cls(np.zeros(0), np.zeros(1), np.array([[0.0, k, 0.0, 0.0]]))

    @property
    def slope_everywhere(self) -> float | None:
        """The slope of a line through the origin; None for any other response."""
        straight = not len(self.breaks) and not self.pieces[0, [0, 2, 3]].any()
        return float(self.pieces[0, 1]) if straight else None

    def __call__(self, strain: Float) -> Float:
        """w at strains (...)."""
        return self._evaluate(strain)[0]

    def slope(self, strain: Float) -> Float:
        """dw/deps at strains (...)."""
        return self._evaluate(strain)[1]

    def _evaluate(self, strain: Float) -> tuple[Float, Float]:
        strain = np.asarray(strain, float)
        i = np.searchsorted(self.breaks, strain)
        t, (a, b, c, d) = strain - self.origins[i], np.moveaxis(self.pieces[i], -1, 0)
        return a + t * (b + t * (c + t * d)), b + t * (2 * c + t * 3 * d)


def response_of(spec: ResponseSpec) -> Response:
    """What the record says, as a function."""
    made = {"line": _line, "two-slopes": _two_slopes, "piecewise": _steps}
    return made.get(spec.model, _polynomial)(spec)


def _line(spec: ResponseSpec) -> Response:
    return Response.line(float(spec.coefficients["k"]))


def _two_slopes(spec: ResponseSpec) -> Response:
    slopes = [spec.coefficients["compression"], spec.coefficients["tension"]]
    return Response(np.zeros(1), np.zeros(2), np.array([[0.0, s, 0.0, 0.0] for s in slopes]))


def _polynomial(spec: ResponseSpec) -> Response:
    k, q, c = (float(spec.coefficients.get(n, 0.0)) for n in ("k", "q", "c"))
    whole = Response(np.zeros(0), np.zeros(1), np.array([[0.0, k, q, c]]))
    return _with_tails(whole, *spec.strain_range)


def _steps(spec: ResponseSpec) -> Response:
    from scipy.interpolate import (
        PchipInterpolator,  # Fritsch & Butland 1984: keeps monotone data so
    )

    x, y = (np.asarray(spec.coefficients[n], float) for n in ("strains", "changes"))
    pieces = PchipInterpolator(x, y).c[::-1].T
    whole = Response(x[1:-1], x[:-1], np.ascontiguousarray(pieces))
    return _with_tails(whole, float(x[0]), float(x[-1]))


def _with_tails(whole: Response, low: float, high: float) -> Response:
    """The response within low to high, and its tangents beyond them."""
    breaks, origins, pieces = whole.breaks, whole.origins, whole.pieces
    if np.isfinite(low):
        tail = [float(whole(np.array(low))), float(whole.slope(np.array(low))), 0.0, 0.0]
        breaks, origins = np.append(low, breaks), np.append(low, origins)
        pieces = np.concatenate([[tail], pieces])
    if np.isfinite(high):
        tail = [float(whole(np.array(high))), float(whole.slope(np.array(high))), 0.0, 0.0]
        breaks, origins = np.append(breaks, high), np.append(origins, high)
        pieces = np.concatenate([pieces, [tail]])
    return Response(breaks, origins, pieces)


@compiled(error_model="numpy")
def respond(strain, breaks, origins, pieces):  # type: ignore[no-untyped-def]
    """w and dw/deps at one strain, for compiled loops."""
    i = 0
    while i < len(breaks) and strain > breaks[i]:
        i += 1
    t = strain - origins[i]
    a, b, c, d = pieces[i, 0], pieces[i, 1], pieces[i, 2], pieces[i, 3]
    return a + t * (b + t * (c + t * d)), b + t * (2 * c + t * 3 * d)
