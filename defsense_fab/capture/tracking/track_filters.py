"""Tracks smoothed in time: a parabola through what is near, weighted by nearness and precision.

Local quadratic regression (Fan & Gijbels 1996, chapter 3) with Epanechnikov's kernel, for each
marker and axis by itself. A motion that is quadratic in time within the window comes through as it
was; the standard deviation never grows.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from ...core.machine.compiled import compiled
from ...core.markers import Tracks

# Places that a marker cannot have come to: swapped numbers, flips, false detections.
#
# A hand moves things with limited acceleration. Of each marker the longest chain of places is kept in
# which each can be reached from the one before: what does not belong to it is taken out (longest path
# by dynamic programming, so that a wrong beginning does not throw away what follows).

#: mm/s and mm/s^2: what hands, and soft things that snap back, do at most.
_SPEED, _ACCELERATION = 2500.0, 60_000.0
_SIGMAS = 5.0
_BACK = 12  # places that a chain may leap over
_FORGET = 0.5  # s after which a marker may be anywhere


def possible(time: Float, points: Float, sigma: Float) -> Bool:
    """Which places (t, m) are kept: `time` (t,) s, `points` (t, m, 3) mm, NaN where there are none,
    `sigma` (t, m, 3) mm their standard deviations along the axes."""
    keep = np.isfinite(points[..., 0])
    for m in range(points.shape[1]):
        rows = np.flatnonzero(keep[:, m])
        if len(rows) < 2:
            continue
        spread = np.linalg.norm(sigma[rows, m], axis=1)
        chain = _chain(time[rows], points[rows, m], spread)
        keep[rows, m] = chain
        rows = rows[chain]
        spikes = _spikes(time[rows], points[rows, m], spread[chain])
        keep[rows[spikes], m] = False
    return keep


def _chain(time: Float, x: Float, sigma: Float) -> Bool:
    """Whether each place is of the longest chain of places within reach of each other."""
    n = len(time)
    length, before = np.ones(n), np.full(n, -1)
    within = np.ones(n, bool)  # reach of all the neighbours: then nothing has to be chosen
    for back in range(1, min(_BACK, n - 1) + 1):
        dt = time[back:] - time[:-back]
        step = np.linalg.norm(x[back:] - x[:-back], axis=1)
        reach = _SPEED * dt + _SIGMAS * np.hypot(sigma[back:], sigma[:-back])
        fine = (step <= reach) | (dt > _FORGET)
        if back == 1:
            if fine.all():
                return within
            table = np.zeros((n, min(_BACK, n - 1) + 1), bool)
        table[back:, back] = fine
    for k in range(1, n):
        for back in range(1, table.shape[1]):
            if k - back < 0:
                break
            if table[k, back] and length[k - back] + 1 > length[k]:
                length[k], before[k] = length[k - back] + 1, k - back
    out = np.zeros(n, bool)
    k = int(length.argmax())
    while k >= 0:
        out[k] = True
        k = int(before[k])
    return out


def _spikes(time: Float, x: Float, sigma: Float) -> Bool:
    """Single places that only an impossible acceleration would explain."""
    out = np.zeros(len(time), bool)
    if len(time) < 3:
        return out
    before, after = time[1:-1] - time[:-2], time[2:] - time[1:-1]
    w = (before / (before + after))[:, None]
    aside = np.linalg.norm(x[1:-1] - (1 - w) * x[:-2] - w * x[2:], axis=1)
    spread = np.sqrt(sigma[1:-1] ** 2 + sigma[:-2] ** 2 + sigma[2:] ** 2)
    beyond = aside - 0.5 * _ACCELERATION * before * after - _SIGMAS * spread
    beyond[before + after > _FORGET] = -1.0
    # The neighbours of a spike stand out half as much.
    worst = np.maximum(beyond, 0.0)
    around = np.maximum(np.append(worst[1:], 0.0), np.insert(worst[:-1], 0, 0.0))
    out[1:-1] = (worst > 0) & (worst >= around)
    return out


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
