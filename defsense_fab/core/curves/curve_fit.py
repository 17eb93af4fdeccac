"""A smooth curve with few control points for what a hand has drawn."""

from __future__ import annotations

import numpy as np

from ..arrays import Float
from .curve import Hermite, catmull_rom, hermite_basis
from .path_sampling import arc_lengths, resample

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
