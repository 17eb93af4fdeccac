"""Tracks smoothed in time: a parabola through what is near, weighted by nearness and precision.

Local quadratic regression (Fan & Gijbels 1996, chapter 3) with Epanechnikov's kernel, for each
marker and axis by itself. A motion that is quadratic in time within the window comes through as it
was; the standard deviation never grows.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...core.errors import CaptureError
from ...core.machine.compiled import compiled
from ...core.tracks import Tracks

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
        raise CaptureError(
            f"smoothing: a window of {window:g} s cannot be; give one above 0",
            code="window-invalid",
        )
    time, seen = tracks.time, tracks.seen
    if not seen.any():
        return tracks
    where = np.broadcast_to(seen[..., None], tracks.points.shape)
    known = np.isfinite(tracks.sigma)
    if (tracks.sigma[where & known] <= 0).any():
        raise CaptureError(
            "smoothing: tracks have standard deviations that are not above 0",
            code="sigma-not-positive",
        )
    trusted = np.asarray((known | ~where).all(axis=(0, 2)))[:, None]
    variance = np.where(where & trusted, tracks.sigma, 1.0) ** 2
    points, less = tracks.points.copy(), np.ones(where.shape)
    fit = _smooth(tracks.time, tracks.points, variance, seen, window / 2, points, less)
    if not fit:
        raise CaptureError(
            f"smoothing: no {_LEAST} points of a marker lie within {window:g} s; frames are"
            f" {np.median(np.diff(time)) if len(time) > 1 else np.nan:.3g} s apart: give a longer"
            " window",
            code="window-too-short",
        )
    return replace(tracks, points=points, sigma=np.where(trusted, tracks.sigma * less, np.nan))


@compiled()
def _smooth(time, points, variance, seen, half, out, less):  # type: ignore[no-untyped-def]
    """Write the fits to `out` and the ratios of their sigma to the points' own to `less`, where
    there are any; how many."""
    fitted = 0
    S, V, T = np.empty(5), np.empty(5), np.empty(3)
    for m in range(points.shape[1]):
        for axis in range(3):
            first = 0
            for t in range(len(time)):
                if not seen[t, m]:
                    continue
                while time[first] <= time[t] - half:
                    first += 1
                S[:], V[:], T[:] = 0.0, 0.0, 0.0
                count = 0
                for i in range(first, len(time)):
                    u = (time[i] - time[t]) / half
                    kernel = 1 - u * u
                    if u >= 1:
                        break
                    if kernel <= 0 or not seen[i, m]:
                        continue
                    count += 1
                    w = kernel * variance[t, m, axis] / variance[i, m, axis]
                    step = points[i, m, axis] - points[t, m, axis]
                    power = 1.0
                    for k in range(5):
                        S[k] += w * power
                        V[k] += w * kernel * power
                        if k < 3:
                            T[k] += w * power * step
                        power *= u
                a0, a1, a2 = (
                    S[2] * S[4] - S[3] ** 2,
                    S[2] * S[3] - S[1] * S[4],
                    S[1] * S[3] - S[2] ** 2,
                )
                det = S[0] * a0 + S[1] * a1 + S[2] * a2
                if count < _LEAST or not det > _SINGULAR * S[0] * S[2] * S[4]:
                    continue
                out[t, m, axis] += (a0 * T[0] + a1 * T[1] + a2 * T[2]) / det
                spread = a0 * a0 * V[0] + 2 * a0 * a1 * V[1] + (a1 * a1 + 2 * a0 * a2) * V[2]
                spread += 2 * a1 * a2 * V[3] + a2 * a2 * V[4]
                less[t, m, axis] = min(1.0, math.sqrt(max(0.0, spread)) / det)
                fitted += 1
    return fitted
