"""Planar curves as chains of circular arcs: solids swept along arcs have exact faces."""

from __future__ import annotations

import numpy as np

from ..arrays import Float
from .curve import Hermite, hermite_basis


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
