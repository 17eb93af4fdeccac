"""How much each marker of each picture counts: less where cameras were less certain, and nothing
where it is plainly not where the others are.

A decoder that bends is fitted, again and again, with Huber's weights (Huber 1964). A marker is
wrong that lies more than `FAR` robust standard deviations off while the others of its picture do
not, or while the pictures before and after do not: tags taken for one another, reflections, a
picture laid wrongly onto the rest pose. Where all markers are off for long it is the decoder.
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.ndimage import median_filter

from ...core.arrays import Bool, Float
from ...decoding.input_decoder import InputFeatures, all_products
from .weighted_ridge import Whitened, solve, sums

FAR = 8.0  # robust standard deviations, beyond which a marker is wrong
_WINDOW = 2.0  # s around a picture
_OWN = 4.0  # times what the others are off
_HUBER, _ROUNDS, _NOISE = 2.5, 12, 2e-3
_LEAST = 0.02  # mm: no scale is less, so that exact data have no wrong markers


def certainty_weights(sigma: Float, seen: Bool, error: Float) -> Float:
    """(t, m), 1 for the marker's usual sigma (t, m, 3) mm and for unknown ones: with the errors
    (m,) mm that a decoder makes besides, the inverse of the variance. Zero where not `seen`."""
    with np.errstate(all="ignore"):
        variance = (sigma**2).mean(axis=2)
    known = np.isfinite(variance)
    usual = np.array(
        [np.median(v[k]) if k.any() else 0.0 for v, k in zip(variance.T, known.T, strict=True)]
    )
    weights = (error**2 + usual) / (error**2 + np.where(known, variance, usual))
    return np.where(seen, np.where(known, weights, 1.0), 0.0)


def wrong_markers(inputs: Float, points: Float, time: Float) -> tuple[Bool, Float]:
    """Which markers (t, m) of `points` (t, m, 3) mm at times (t,) s are wrong, by what the signals,
    `inputs` (t, c), say; and the scale (m,) mm of what the others are off, along an axis."""
    t, c = inputs.shape
    seen = np.isfinite(points[..., 0])
    features = InputFeatures(c, all_products(c), np.zeros((0, c)), np.ones(c))
    phi = features(inputs)
    turned = Whitened.of(phi, features.slopes(inputs), features.roughness())
    x = turned(phi)
    outputs = np.where(seen[..., None], points, 0.0)
    weights, one = seen.astype(float), np.zeros(t, np.int64)
    far, scale = np.zeros_like(seen), np.zeros(points.shape[1])
    for _ in range(_ROUNDS):
        beta, constant = solve(sums(x, outputs, weights, one).without(), np.array([_NOISE]))
        off = np.linalg.norm((x @ beta[0] + constant[0]).reshape(outputs.shape) - outputs, axis=2)
        scale = np.array([_scale(o[s]) for o, s in zip(off.T, seen.T, strict=True)])
        before, far = far, seen & _apart(np.where(seen, off / scale, np.nan), time)
        if (far == before).all() and not far.any():
            break
        ratio = _HUBER * scale / np.maximum(off, 1e-12)
        weights = np.where(seen, np.minimum(1.0, ratio) * ~far, 0.0)
    return far, scale


def _apart(off: Float, time: Float) -> Bool:
    """Which (t, m), in robust standard deviations and NaN where not seen, are off by themselves."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # pictures without a marker
        usual = np.nanmedian(off, axis=1)
    known = np.isfinite(usual)
    if known.any():
        usual = np.interp(time, time[known], usual[known])
    width = max(2 * round(_WINDOW / max(float(np.median(np.diff(time))), 1e-3) / 2) + 1, 3)
    around = median_filter(usual, width, mode="nearest")
    others = np.minimum(usual, around)[:, None]
    return np.asarray((off > FAR) & (off > _OWN * others))


def _scale(off: Float) -> float:
    """Along an axis, of distances (n,): the median of a Maxwell distribution is 1.538 of it."""
    return max(float(np.median(off)) / 1.538, _LEAST) if len(off) else _LEAST
