"""Convert strokes drawn by hand to Hermite curves, and Hermite curves to circular arcs."""

from __future__ import annotations

import numpy as np

from .arrays import Float
from .curve import Hermite, arc_lengths, catmull_rom, hermite_basis, resample

_SAMPLES_PER_SPAN = 20
MIN_FIT_POINTS = 4  #: Fewest control points of a fitted curve, as few as device.toml accepts.
_MAX_CONTROL_POINTS = 12
_REPARAMETRIZATIONS = 3
_MAX_BIARCS_PER_SPAN = 64


def fit_curve(
    stroke: Float, tolerance: float, counts: tuple[int, int] = (MIN_FIT_POINTS, _MAX_CONTROL_POINTS)
) -> Hermite:
    """Fit a smooth curve with few control points to a stroke.

    The curve ends where the stroke ends, and its tangents follow from its points. Its points are a
    least-squares fit: with spans of equal length, Catmull-Rom tangents are linear in them.

    Args:
        stroke: Points of the stroke (q, 2) or (q, 3), mm.
        tolerance: Largest distance of the stroke from the curve, mm.
        counts: Smallest and largest number of control points.

    Returns:
        The curve with the fewest control points within the tolerance, or else the closest one.

    Raises:
        ValueError: The stroke has no length.
    """
    stroke = np.asarray(stroke, float)
    step = np.linalg.norm(np.diff(stroke, axis=0), axis=1)
    stroke = stroke[np.append(True, step > 1e-9)]
    length = arc_lengths(stroke)[-1] if len(stroke) > 1 else 0.0
    if length <= 1e-6:
        raise ValueError("a stroke needs a length")
    best, best_deviation = None, np.inf
    for count in range(counts[0], counts[1] + 1):
        curve = _fit_points(stroke, float(length), count)
        deviation = float(_project_on_curve(stroke, curve)[0].max())
        if deviation < best_deviation:
            best, best_deviation = curve, deviation
        if deviation <= tolerance:
            break
    assert best is not None
    return best


def _fit_points(stroke: Float, length: float, count: int) -> Hermite:
    """Fit `count` control points.

    The curve parameters of the samples first follow the length along the stroke, which a trembling
    hand increases, and then the projection on the fitted curve.
    """
    samples = resample(stroke, 0.0, length, (count - 1) * _SAMPLES_PER_SPAN + 1)
    parameters = np.linspace(0, count - 1, len(samples))
    for _ in range(_REPARAMETRIZATIONS):
        curve = _fit_at_parameters(samples, parameters, count)
        parameters = _project_on_curve(samples, curve)[1]
    return curve


def _fit_at_parameters(samples: Float, parameters: Float, count: int) -> Hermite:
    """Fit a curve to samples (q, d) at curve parameters (q,) by least squares."""
    difference = np.zeros((count, count))
    for k in range(count):
        low, high = max(k - 1, 0), min(k + 1, count - 1)
        difference[k, high] += 1 / (high - low)
        difference[k, low] -= 1 / (high - low)
    dense = hermite_basis(count, _SAMPLES_PER_SPAN)[0] @ np.concatenate([np.eye(count), difference])
    grid = np.linspace(0, count - 1, len(dense))
    linear = np.stack([np.interp(parameters, grid, column) for column in dense.T], axis=1)
    points = np.empty((count, samples.shape[1]))
    points[[0, -1]] = samples[[0, -1]]
    if count > 2:
        remainder = samples - linear[:, [0, -1]] @ points[[0, -1]]
        points[1:-1] = np.linalg.lstsq(linear[:, 1:-1], remainder, rcond=None)[0]
    return Hermite(points, catmull_rom(points))


def _project_on_curve(points: Float, curve: Hermite) -> tuple[Float, Float]:
    """Return the distances (q,) in mm of points (q, d) from a curve, and its parameters (q,)."""
    line = curve.sample(_SAMPLES_PER_SPAN)
    a, along = line[:-1], np.diff(line, axis=0)
    square = np.maximum((along**2).sum(1), 1e-18)
    t = np.clip(np.einsum("qsk,sk->qs", points[:, None] - a, along) / square, 0, 1)
    gap = ((points[:, None] - a - t[..., None] * along) ** 2).sum(2)
    k = gap.argmin(1)
    row = np.arange(len(points))
    return np.sqrt(gap[row, k]), (k + t[row, k]) / _SAMPLES_PER_SPAN


def curve_to_arcs(curve: Hermite, tolerance: float) -> Float:
    """Approximate a curve by circular arcs, since solids swept along arcs have exact faces.

    Every span becomes biarcs between points of the curve, with the curve's tangents there. A span
    is halved until its biarcs stay within the tolerance.

    Args:
        curve: The curve.
        tolerance: Largest deviation of the arcs from the curve, mm.

    Returns:
        Arcs (n, 3, 2) that join smoothly, each given by its start, middle and end, mm.

    References:
        Bolton 1975 (biarcs).
    """
    stack = np.concatenate([curve.points, curve.tangents])
    out = []
    for span in range(len(curve.points) - 1):
        pieces = 1
        while True:
            arcs, deviation = _span_to_arcs(stack, span, pieces)
            if deviation <= tolerance or pieces >= _MAX_BIARCS_PER_SPAN:
                break
            pieces *= 2
        out.append(arcs)
    return np.concatenate(out)


def _span_to_arcs(stack: Float, span: int, pieces: int) -> tuple[Float, float]:
    """Return the arcs of biarcs at equal parameter steps of a span, and their deviation in mm."""
    fine = 8 * pieces
    count = len(stack) // 2
    own = np.concatenate([stack[span : span + 2], stack[count + span : count + span + 2]])
    position, first, _ = hermite_basis(2, fine)
    points = position @ own
    tangents = first @ own
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    arcs: list[Float] = []
    deviation = 0.0
    for i in range(pieces):
        a, b = 8 * i, 8 * (i + 1)
        pair = _biarc(points[a], tangents[a], points[b], tangents[b])
        arcs += pair
        distances = [np.min([_arc_distance(q, arc) for arc in pair]) for q in points[a + 1 : b]]
        deviation = max(deviation, float(np.max(distances)))
    return np.stack(arcs), deviation


def _biarc(p: Float, t: Float, q: Float, s: Float) -> list[Float]:
    """Return two arcs from p (tangent t) to q (tangent s), with equal tangent lengths."""
    v, w = q - p, t + s
    a, b, c = float(2 * (1 - t @ s)), float(v @ w), float(v @ v)
    # d solves a d^2 + 2 b d - c = 0; this form also holds where a vanishes.
    d = c / (b + np.sqrt(b * b + a * c))
    joint = (p + d * t + q - d * s) / 2
    return [_arc(p, t, joint), _arc(q, -s, joint)[::-1]]


def _arc(p: Float, t: Float, q: Float) -> Float:
    """Return start, middle and end of the arc that leaves p along t and ends in q."""
    v = q - p
    half = np.arctan2(t[0] * v[1] - t[1] * v[0], t @ v) / 2  # a quarter of the arc's angle
    normal = np.array([v[1], -v[0]])
    return np.stack([p, p + v / 2 + normal / 2 * np.tan(half), q])


def _arc_distance(x: Float, arc: Float) -> float:
    """Return the distance in mm of a point close to an arc from its circle or line."""
    a, m, b = arc
    u, v = m - a, b - a
    cross = u[0] * v[1] - u[1] * v[0]
    if abs(cross) < 1e-9 * (v @ v):
        n = np.array([-v[1], v[0]]) / np.linalg.norm(v)
        return float(abs((x - a) @ n))
    k = np.array([v[1] * (u @ u) - u[1] * (v @ v), u[0] * (v @ v) - v[0] * (u @ u)]) / (2 * cross)
    return float(abs(np.linalg.norm(x - a - k) - np.linalg.norm(k)))
