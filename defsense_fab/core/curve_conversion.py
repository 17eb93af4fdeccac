"""Planar curves as chains of circular arcs: solids swept along arcs have exact faces."""

from __future__ import annotations

import numpy as np

from .arrays import Float
from .curve import Hermite, arc_lengths, catmull_rom, hermite_basis, resample

# A smooth curve with few control points for what a hand has drawn.

_DENSE = 20  # samples of each span of the curve
_FEWEST, _MOST = 2, 12  # control points
_ROUNDS = 3


def fit_curve(stroke: Float, tolerance: float, most: int = _MOST) -> Hermite:
    """The curve with the fewest control points, at most `most`, that stays within `tolerance` mm of
    a `stroke` (q, 2) mm and ends where it ends; its tangents are those that its points give.

    Points come from least squares: for spans of equal length the tangents of Catmull and Rom
    are linear in them. Raises ValueError for a stroke without length.
    """
    stroke = np.asarray(stroke, float)
    step = np.linalg.norm(np.diff(stroke, axis=0), axis=1)
    stroke = stroke[np.append(True, step > 1e-9)]
    length = arc_lengths(stroke)[-1] if len(stroke) > 1 else 0.0
    if length <= 1e-6:
        raise ValueError("a stroke needs a length")
    best, least = None, np.inf
    for count in range(_FEWEST, most + 1):
        curve = _fitted(stroke, float(length), count)
        off = float(_nearest(stroke, curve)[0].max())
        if off < least:
            best, least = curve, off
        if off <= tolerance:
            break
    assert best is not None
    return best


def _fitted(stroke: Float, length: float, count: int) -> Hermite:
    """With `count` points: first by length along the stroke, which a trembling hand makes longer
    than it is, then by where its points are nearest to the curve found."""
    samples = resample(stroke, 0.0, length, (count - 1) * _DENSE + 1)
    places = np.linspace(0, count - 1, len(samples))
    for _ in range(_ROUNDS):
        curve = _through(samples, places, count)
        places = _nearest(samples, curve)[1]
    return curve


def _through(samples: Float, places: Float, count: int) -> Hermite:
    """By least squares of samples (q, 2) at curve parameters (q,)."""
    difference = np.zeros((count, count))
    for k in range(count):
        low, high = max(k - 1, 0), min(k + 1, count - 1)
        difference[k, high] += 1 / (high - low)
        difference[k, low] -= 1 / (high - low)
    dense = hermite_basis(count, _DENSE)[0] @ np.concatenate([np.eye(count), difference])
    grid = np.linspace(0, count - 1, len(dense))
    linear = np.stack([np.interp(places, grid, column) for column in dense.T], axis=1)
    points = np.empty((count, 2))
    points[[0, -1]] = samples[[0, -1]]
    if count > 2:
        left = samples - linear[:, [0, -1]] @ points[[0, -1]]
        points[1:-1] = np.linalg.lstsq(linear[:, 1:-1], left, rcond=None)[0]
    return Hermite(points, catmull_rom(points))


def _nearest(stroke: Float, curve: Hermite) -> tuple[Float, Float]:
    """Distance (q,) mm from each point of the stroke to the curve, and the curve's parameter."""
    line = curve.sample(_DENSE)
    a, along = line[:-1], np.diff(line, axis=0)
    square = np.maximum((along**2).sum(1), 1e-18)
    t = np.clip(np.einsum("qsk,sk->qs", stroke[:, None] - a, along) / square, 0, 1)
    gap = ((stroke[:, None] - a - t[..., None] * along) ** 2).sum(2)
    k = gap.argmin(1)
    row = np.arange(len(stroke))
    return np.sqrt(gap[row, k]), (k + t[row, k]) / _DENSE


def arcs(curve: Hermite, tolerance: float) -> Float:
    """Arcs (n, 3, 2) mm, each by start, middle and end, smooth where they meet.

    Every span becomes biarcs (Bolton 1975) between points of the curve with its tangents there;
    a span is halved until its biarcs stay within `tolerance` mm of it.
    """
    stack = np.concatenate([curve.points, curve.tangents])
    out = []
    for span in range(len(curve.points) - 1):
        pieces = 1
        while True:
            found, deviation = _span(stack, span, pieces)
            if deviation <= tolerance or pieces >= 64:
                break
            pieces *= 2
        out.append(found)
    return np.concatenate(out)


def _span(stack: Float, span: int, pieces: int) -> tuple[Float, float]:
    """Biarcs of one span in equal steps of its parameter, and their largest deviation, mm."""
    fine = 8 * pieces
    count = len(stack) // 2
    own = np.concatenate([stack[span : span + 2], stack[count + span : count + span + 2]])
    position, first, _ = hermite_basis(2, fine)
    points = position @ own
    tangents = first @ own
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    found: list[Float] = []
    deviation = 0.0
    for i in range(pieces):
        a, b = 8 * i, 8 * (i + 1)
        pair = _biarc(points[a], tangents[a], points[b], tangents[b])
        found += pair
        away = [np.min([_distance(q, arc) for arc in pair]) for q in points[a + 1 : b]]
        deviation = max(deviation, float(np.max(away)))
    return np.stack(found), deviation


def _biarc(p: Float, t: Float, q: Float, s: Float) -> list[Float]:
    """Two arcs from p (tangent t) to q (tangent s), with equal tangent lengths."""
    v, w = q - p, t + s
    a, b, c = float(2 * (1 - t @ s)), float(v @ w), float(v @ v)
    # d solves a d^2 + 2 b d - c = 0; this form stands where a vanishes.
    d = c / (b + np.sqrt(b * b + a * c))
    joint = (p + d * t + q - d * s) / 2
    return [_arc(p, t, joint), _arc(q, -s, joint)[::-1]]


def _arc(p: Float, t: Float, q: Float) -> Float:
    """Start, middle, end of the arc that leaves p along t and ends in q."""
    v = q - p
    half = np.arctan2(t[0] * v[1] - t[1] * v[0], t @ v) / 2  # a quarter of the arc's angle
    normal = np.array([v[1], -v[0]])
    return np.stack([p, p + v / 2 + normal / 2 * np.tan(half), q])


def _distance(x: Float, arc: Float) -> float:
    """Distance of a point near an arc from its circle (or line), mm."""
    a, m, b = arc
    u, v = m - a, b - a
    cross = u[0] * v[1] - u[1] * v[0]
    if abs(cross) < 1e-9 * (v @ v):
        n = np.array([-v[1], v[0]]) / np.linalg.norm(v)
        return float(abs((x - a) @ n))
    k = np.array([v[1] * (u @ u) - u[1] * (v @ v), u[0] * (v @ v) - v[0] * (u @ u)]) / (2 * cross)
    return float(abs(np.linalg.norm(x - a - k) - np.linalg.norm(k)))
