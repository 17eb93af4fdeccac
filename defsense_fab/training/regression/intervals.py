"""The trained range of a decoder's inputs, and conformal intervals of its errors.

Conformal prediction gives intervals that hold on new data, from errors on folds that were left out.
Blocks of neighboring frames are exchanged, since neighboring frames are not independent. The error
of a marker is compared with the usual error at the same distance from the training data, so the
interval is wider where the decoder was trained on little.

References:
    Vovk, Gammerman & Shafer 2005, Algorithmic Learning in a Random World.
    Lei et al. 2018, Distribution-free predictive inference for regression (split conformal).
    Chernozhukov, Wuthrich & Zhu 2018, Exact and robust conformal inference (blocks).
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...decoding.trained_model import Intervals, TrainedRange
from ..options import TrainOptions

_BLOCK_S = 5.0
_BIN_COUNT = 6  # of the distance; the usual error is a straight line through their means
_MIN_VARIANCE = 1e-3  # smaller variances of correlated inputs are noise
_RANGE_QUANTILE = 0.99  # share of the training's distances below 1


def fit_trained_range(inputs: Float, signals: Float) -> TrainedRange:
    """Describe where the inputs of a decoder were in training.

    Args:
        inputs: The decoder's inputs in training, shape (t, d).
        signals: The signals among them, shape (t, c).

    Returns:
        The range, from which distances of new inputs are measured.
    """
    center = inputs.mean(0)
    spread = np.maximum(inputs.std(0), 1e-9)
    correlation = np.cov(((inputs - center) / spread).T).reshape(len(center), -1)
    values, vectors = np.linalg.eigh(correlation)
    whiten = (vectors / np.sqrt(np.maximum(values, _MIN_VARIANCE))) / spread[:, None]
    distance = np.sqrt((((inputs - center) @ whiten) ** 2).mean(axis=1))
    usual = max(float(np.quantile(distance, _RANGE_QUANTILE)), 1e-9)
    return TrainedRange(center, whiten, usual, signals.min(0), signals.max(0))


def fit_intervals(
    errors: Float, distance: Float, time: Float, level: float = TrainOptions.level
) -> Intervals:
    """Fit conformal intervals to errors on frames that a decoder was not trained on.

    Args:
        errors: Errors of the markers, shape (t, m), mm; NaN in gaps.
        distance: Distance of each frame's inputs from the trained range, shape (t,).
        time: Times of the frames, shape (t,), s.
        level: Probability that a marker lies within its interval.

    Returns:
        The intervals of the m markers.
    """
    m = errors.shape[1]
    is_known = np.isfinite(errors)
    spread, slope, factor = np.empty(m), np.zeros(m), np.ones(m)
    for k in range(m):
        e, d = errors[is_known[:, k], k], distance[is_known[:, k]]
        spread[k], slope[k] = _fit_usual_error(e, d)
        factor[k] = _block_quantile(e / (spread[k] + slope[k] * d), time[is_known[:, k]], level)
    return Intervals(level, factor, spread, slope)


def _fit_usual_error(errors: Float, distance: Float) -> tuple[float, float]:
    """Fit spread + slope * distance, neither negative, to mean errors in bins of distance."""
    if len(errors) < 10 * _BIN_COUNT:
        return max(float(np.mean(errors)), 1e-9) if len(errors) else 1.0, 0.0
    order = np.argsort(distance)
    x, y = (
        np.array([p.mean() for p in np.array_split(v[order], _BIN_COUNT)])
        for v in (distance, errors)
    )
    slope = max(float(np.polyfit(x, y, 1)[0]), 0.0)
    spread = float((y - slope * x).mean())
    if spread <= 0:
        spread, slope = 1e-3 * float(y.mean()), float((x * y).sum() / (x * x).sum())
    return max(spread, 1e-9), slope


def _block_quantile(scores: Float, time: Float, level: float) -> float:
    """Return the score below which the share `level` of a new block lies.

    With b blocks, the quantile is taken as if there were b + 1.
    """
    if not len(scores):
        return 1.0
    blocks = len(np.unique(np.floor(time / _BLOCK_S)))
    return float(np.quantile(scores, min(level * (blocks + 1) / blocks, 1.0)))
