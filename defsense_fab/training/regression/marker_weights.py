"""Weights of the markers in each frame: less for uncertain ones, none for wrong ones.

A quadratic decoder is fitted repeatedly with Huber's weights. A marker is wrong if its residual is
larger than `WRONG_MARKER_SIGMAS` robust standard deviations while those of the frame's other
markers, or of the frames before and after, are not. Causes are mistaken tags, reflections, and
frames that were aligned wrongly to the rest pose. Where all markers are off for long, the decoder
is wrong and not the markers.

References:
    Huber 1964, Robust estimation of a location parameter.
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.ndimage import median_filter

from ...core.arrays import Bool, Float
from ...decoding.input_decoder import InputFeatures, all_products, no_products
from .candidates import has_few_products
from .weighted_ridge import Whitening, accumulate_sums, solve_ridge

#: Robust standard deviations beyond which a marker is wrong.
WRONG_MARKER_SIGMAS = 8.0

_WINDOW_S = 2.0  # around a frame
_RESIDUAL_RATIO = 4.0  # of a wrong marker's residual over that of the others
_HUBER_SIGMAS, _MAX_ROUNDS, _INPUT_NOISE = 2.5, 12, 2e-3
_MIN_SCALE_MM = 0.02  # so that exact data have no wrong markers


def weight_by_certainty(sigma: Float, visible: Bool, error: Float) -> Float:
    """Weight markers by the inverse of their variance.

    Args:
        sigma: Standard deviations of the positions, shape (t, m, 3), mm; NaN where unknown.
        visible: Which markers are to be used, shape (t, m).
        error: Error that a decoder makes in addition, shape (m,), mm along an axis.

    Returns:
        Weights, shape (t, m): 1 for the marker's median sigma and where sigma is unknown, 0 where
        the marker is not visible.
    """
    with np.errstate(all="ignore"):
        variance = (sigma**2).mean(axis=2)
    is_known = np.isfinite(variance)
    usual = np.array(
        [np.median(v[k]) if k.any() else 0.0 for v, k in zip(variance.T, is_known.T, strict=True)]
    )
    weights = (error**2 + usual) / (error**2 + np.where(is_known, variance, usual))
    return np.where(visible, np.where(is_known, weights, 1.0), 0.0)


def find_wrong_markers(inputs: Float, points: Float, time: Float) -> tuple[Bool, Float]:
    """Find markers whose positions contradict the signals.

    Args:
        inputs: Signals at the frames, shape (t, c).
        points: Marker positions, shape (t, m, 3), mm; NaN in gaps.
        time: Times of the frames, shape (t,), s.

    Returns:
        Which markers are wrong, shape (t, m), and the scale of the other markers' residuals, shape
        (m,), mm along an axis.
    """
    t, c = inputs.shape
    visible = np.isfinite(points[..., 0])
    products = all_products(c) if has_few_products(c, t) else no_products()
    features = InputFeatures(c, products, np.zeros((0, c)), np.ones(c))
    _, x = Whitening.fit(features, inputs)
    outputs = np.where(visible[..., None], points, 0.0)
    weights, one_fold = visible.astype(float), np.zeros(t, np.int64)
    is_wrong, scale = np.zeros_like(visible), np.zeros(points.shape[1])
    for _ in range(_MAX_ROUNDS):
        sums = accumulate_sums(x, outputs, weights, one_fold).without()
        beta, constant = solve_ridge(sums, np.array([_INPUT_NOISE]))
        predicted = (x @ beta[0] + constant[0]).reshape(outputs.shape)
        residual = np.linalg.norm(predicted - outputs, axis=2)
        scale = np.array([_axis_scale(o[s]) for o, s in zip(residual.T, visible.T, strict=True)])
        previous = is_wrong
        is_wrong = visible & _stands_out(np.where(visible, residual / scale, np.nan), time)
        if (is_wrong == previous).all() and not is_wrong.any():
            break
        ratio = _HUBER_SIGMAS * scale / np.maximum(residual, 1e-12)
        weights = np.where(visible, np.minimum(1.0, ratio) * ~is_wrong, 0.0)
    return is_wrong, scale


def _stands_out(residual: Float, time: Float) -> Bool:
    """Return which residuals (t, m) are large while those around them are not.

    They are in robust standard deviations, NaN where the marker is not visible.
    """
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without a marker
        usual = np.nanmedian(residual, axis=1)
    is_known = np.isfinite(usual)
    if is_known.any():
        usual = np.interp(time, time[is_known], usual[is_known])
    width = max(2 * round(_WINDOW_S / max(float(np.median(np.diff(time))), 1e-3) / 2) + 1, 3)
    around = median_filter(usual, width, mode="nearest")
    others = np.minimum(usual, around)[:, None]
    return np.asarray((residual > WRONG_MARKER_SIGMAS) & (residual > _RESIDUAL_RATIO * others))


def _axis_scale(distance: Float) -> float:
    """Return the scale along an axis of distances (n,), whose median in theory is 1.538 times it.

    The distances are taken to have a Maxwell distribution.
    """
    return (
        max(float(np.median(distance)) / 1.538, _MIN_SCALE_MM) if len(distance) else _MIN_SCALE_MM
    )
