"""Tracks smoothed in time: a parabola through what is near, weighted by nearness and precision.

Local quadratic regression (Fan & Gijbels 1996, chapter 3) with Epanechnikov's kernel, for each
marker and axis by itself. A motion that is quadratic in time within the window comes through as it
was; the standard deviation never grows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.arrays import Float
from ..core.errors import CaptureError
from ..core.tracks import Tracks

_LEAST = 4  # points in a window: three determine the parabola and smooth nothing
_SINGULAR = 1e-9  # of the moments' determinant, relative to its greatest possible value


def smooth(tracks: Tracks, window: float) -> Tracks:
    """Each point that was seen replaced by the value there of the parabola fitted over `window` s
    about it (half before, half after), with weights 1/sigma^2, or equal ones for markers whose
    sigma is not known throughout; `sigma` is that of the fit, from the points' own, as if their
    errors were independent. What was not seen stays so; points with fewer than three others in the
    window, or all but at one or two instants of it, stay as they were. The caller must say that the
    result was smoothed. Raises CaptureError for a window that smooths nothing, or sigma that is not
    positive."""
    if not (np.isfinite(window) and window > 0):
        raise CaptureError(f"smoothing: a window of {window:g} s cannot be; give one above 0")
    time, seen = tracks.time, tracks.seen
    if not seen.any():
        return tracks
    where = np.broadcast_to(seen[..., None], tracks.points.shape)
    known = np.isfinite(tracks.sigma)
    if (tracks.sigma[where & known] <= 0).any():
        raise CaptureError("smoothing: tracks have standard deviations that are not above 0")
    trusted = np.asarray((known | ~where).all(axis=(0, 2)))[:, None]
    variance = np.where(where & trusted, tracks.sigma, 1.0) ** 2
    y = np.where(where, tracks.points, 0.0)

    count = np.zeros(where.shape, np.int64)
    S, V, T = (np.zeros((k, *where.shape)) for k in (5, 5, 3))
    half = window / 2
    reach = _reach(time, half)
    for shift in range(-reach, reach + 1):
        at = np.arange(max(0, -shift), len(time) - max(0, shift))
        u = ((time[at + shift] - time[at]) / half)[:, None, None]
        kernel = np.where(where[at + shift] & where[at], np.maximum(1 - u * u, 0.0), 0.0)
        w = kernel * (variance[at] / variance[at + shift])
        step = y[at + shift] - y[at]
        count[at] += kernel > 0
        for k in range(5):
            S[k, at] += w * u**k
            V[k, at] += w * kernel * u**k
            if k < 3:
                T[k, at] += w * u**k * step

    a = np.stack([S[2] * S[4] - S[3] ** 2, S[2] * S[3] - S[1] * S[4], S[1] * S[3] - S[2] ** 2])
    det = (S[:3] * a).sum(axis=0)
    fit = (count >= _LEAST) & (det > _SINGULAR * S[0] * S[2] * S[4])
    if not fit.any():
        raise CaptureError(
            f"smoothing: no {_LEAST} points of a marker lie within {window:g} s; frames are"
            f" {np.median(np.diff(time)) if len(time) > 1 else np.nan:.3g} s apart: give a longer"
            " window"
        )
    a /= np.where(fit, det, 1.0)
    spread = sum(a[i] * a[j] * V[i + j] for i in range(3) for j in range(3))
    points = np.where(fit, tracks.points + (a * T).sum(axis=0), tracks.points)
    less = np.sqrt(np.where(fit, np.clip(spread, 0.0, 1.0), 1.0))
    sigma = np.where(trusted & where, tracks.sigma * less, np.nan)
    return replace(tracks, points=points, sigma=sigma)


def _reach(time: Float, half: float) -> int:
    """The most frames that are nearer than `half` s on one side of any."""
    index = np.arange(len(time))
    return int((np.searchsorted(time, time + half) - 1 - index).max(initial=0))
