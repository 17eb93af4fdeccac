"""Intervals that hold what they promise, from errors on folds that were left out.

Conformal prediction (Vovk, Gammerman & Shafer 2005; split conformal: Lei et al. 2018) with blocks
of neighbouring pictures as what is exchanged (Chernozhukov, Wuthrich & Zhu 2018): pictures beside
each other are not independent. The error of a marker is compared with what is usual at the signals'
distance from what was trained on, so that the interval is wider where the decoder has seen little.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...decoding.trained_model import Intervals, TrainedRange

# Where the inputs of a decoder were in training, to tell later how far they are from there.

_LEAST = 1e-3  # of the variance, below which a direction of correlated inputs is noise
_USUAL = 0.99  # of the training's distances lie below one


def trained_range(inputs: Float, signals: Float) -> TrainedRange:
    """Of inputs (t, d), and of the signals (t, c) among them."""
    middle = inputs.mean(0)
    spread = np.maximum(inputs.std(0), 1e-9)
    correlation = np.cov(((inputs - middle) / spread).T).reshape(len(middle), -1)
    values, vectors = np.linalg.eigh(correlation)
    whiten = (vectors / np.sqrt(np.maximum(values, _LEAST))) / spread[:, None]
    apart = np.sqrt((((inputs - middle) @ whiten) ** 2).mean(axis=1))
    usual = max(float(np.quantile(apart, _USUAL)), 1e-9)
    return TrainedRange(middle, whiten, usual, signals.min(0), signals.max(0))


LEVEL = 0.9
_BLOCK = 5.0  # s
_BINS = 6  # of the distance, between which the usual error is a straight line


def conformal(errors: Float, distance: Float, time: Float, level: float = LEVEL) -> Intervals:
    """Of errors (t, m) mm on pictures that were left out, NaN in gaps, at distances (t,) from the
    training and times (t,) s."""
    m = errors.shape[1]
    known = np.isfinite(errors)
    spread, slope, factor = np.empty(m), np.zeros(m), np.ones(m)
    for k in range(m):
        e, d = errors[known[:, k], k], distance[known[:, k]]
        spread[k], slope[k] = _usual(e, d)
        factor[k] = _quantile(e / (spread[k] + slope[k] * d), time[known[:, k]], level)
    return Intervals(level, factor, spread, slope)


def _usual(errors: Float, distance: Float) -> tuple[float, float]:
    """spread + slope * distance, neither negative, through the mean errors in bins of distance."""
    if len(errors) < 10 * _BINS:
        return max(float(np.mean(errors)), 1e-9) if len(errors) else 1.0, 0.0
    order = np.argsort(distance)
    x, y = (
        np.array([p.mean() for p in np.array_split(v[order], _BINS)]) for v in (distance, errors)
    )
    slope = max(float(np.polyfit(x, y, 1)[0]), 0.0)
    spread = float((y - slope * x).mean())
    if spread <= 0:
        spread, slope = 1e-3 * float(y.mean()), float((x * y).sum() / (x * x).sum())
    return max(spread, 1e-9), slope


def _quantile(scores: Float, time: Float, level: float) -> float:
    """The score that `level` of the next block's lie under: with b blocks, as for b + 1."""
    if not len(scores):
        return 1.0
    blocks = len(np.unique(np.floor(time / _BLOCK)))
    return float(np.quantile(scores, min(level * (blocks + 1) / blocks, 1.0)))
