"""Filter tracks in time: remove impossible positions, and smooth the rest.

Swapped numbers, flips and false detections move a marker impossibly fast, but a hand moves things
with limited acceleration. For each marker the longest chain of positions is kept in which each can
be reached from the previous one; other positions are removed. The chain is found by dynamic
programming, so a wrong start does not discard what follows.

Smoothing is local quadratic regression (Fan & Gijbels 1996, chapter 3) with Epanechnikov's kernel,
for each marker and axis separately. A motion that is quadratic in time within the window is
unchanged, and standard deviations never grow.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from ...core.machine.compiled import compiled
from ...core.markers import Tracks

#: Of hands, and of soft things that snap back.
MAX_SPEED_MM_S, MAX_ACCELERATION_MM_S2 = 2500.0, 60_000.0
NOISE_SIGMAS = 5.0
MAX_SKIPPED = 12  # positions of a chain
MAX_GAP_S = 0.5  # after which a marker may be anywhere


def find_reachable(time: Float, points: Float, sigma: Float) -> Bool:
    """Return which positions (t, m) a marker can have reached.

    Args:
        time: Times (t,), s.
        points: Positions (t, m, 3), mm, NaN where not known.
        sigma: Standard deviations along the axes (t, m, 3), mm.
    """
    keep = np.isfinite(points[..., 0])
    for m in range(points.shape[1]):
        rows = np.flatnonzero(keep[:, m])
        if len(rows) < 2:
            continue
        total_sigma = np.linalg.norm(sigma[rows, m], axis=1)
        chain = _longest_chain(time[rows], points[rows, m], total_sigma)
        keep[rows, m] = chain
        rows = rows[chain]
        spikes = _spikes(time[rows], points[rows, m], total_sigma[chain])
        keep[rows[spikes], m] = False
    return keep


def _longest_chain(time: Float, points: Float, sigma: Float) -> Bool:
    """Return whether each position is in the longest chain of reachable positions."""
    n = len(time)
    length, previous = np.ones(n), np.full(n, -1)
    all_kept = np.ones(n, bool)  # if all neighbors are reachable
    for back in range(1, min(MAX_SKIPPED, n - 1) + 1):
        dt = time[back:] - time[:-back]
        step = np.linalg.norm(points[back:] - points[:-back], axis=1)
        reach = MAX_SPEED_MM_S * dt + NOISE_SIGMAS * np.hypot(sigma[back:], sigma[:-back])
        is_reachable = (step <= reach) | (dt > MAX_GAP_S)
        if back == 1:
            if is_reachable.all():
                return all_kept
            reachable = np.zeros((n, min(MAX_SKIPPED, n - 1) + 1), bool)
        reachable[back:, back] = is_reachable
    for k in range(1, n):
        for back in range(1, reachable.shape[1]):
            if k - back < 0:
                break
            if reachable[k, back] and length[k - back] + 1 > length[k]:
                length[k], previous[k] = length[k - back] + 1, k - back
    out = np.zeros(n, bool)
    k = int(length.argmax())
    while k >= 0:
        out[k] = True
        k = int(previous[k])
    return out


def _spikes(time: Float, points: Float, sigma: Float) -> Bool:
    """Return single positions that only an impossible acceleration would explain."""
    is_spike = np.zeros(len(time), bool)
    if len(time) < 3:
        return is_spike
    step_before, step_after = time[1:-1] - time[:-2], time[2:] - time[1:-1]
    share = (step_before / (step_before + step_after))[:, None]
    deviation = np.linalg.norm(
        points[1:-1] - (1 - share) * points[:-2] - share * points[2:], axis=1
    )
    spread = np.sqrt(sigma[1:-1] ** 2 + sigma[:-2] ** 2 + sigma[2:] ** 2)
    excess = (
        deviation - 0.5 * MAX_ACCELERATION_MM_S2 * step_before * step_after - NOISE_SIGMAS * spread
    )
    excess[step_before + step_after > MAX_GAP_S] = -1.0
    # The neighbors of a spike stand out half as much.
    positive_excess = np.maximum(excess, 0.0)
    neighbor_excess = np.maximum(
        np.append(positive_excess[1:], 0.0), np.insert(positive_excess[:-1], 0, 0.0)
    )
    is_spike[1:-1] = (positive_excess > 0) & (positive_excess >= neighbor_excess)
    return is_spike


MIN_WINDOW_POINTS = 4  # three determine the parabola and smooth nothing
MIN_DETERMINANT = 1e-9  # of the moments, relative to its largest possible value


def smooth(tracks: Tracks, window: float) -> Tracks:
    """Replace each visible point by a local parabola.

    Weights are 1/sigma^2, or equal for markers whose sigma is not known throughout. The result's
    `sigma` is that of the fit, as if the points' errors were independent. Points with fewer than
    three others in the window, or with all but at one or two instants of it, stay unchanged. The
    caller must state that the result was smoothed.

    Args:
        tracks: Tracks to smooth.
        window: Width of the window, s, half before and half after a point.

    Raises:
        CaptureError: If the window smooths nothing, or sigma is not positive.
    """
    if not (np.isfinite(window) and window > 0):
        raise CaptureError(
            f"a window of {window:g} s is not possible",
            code="window-invalid",
            where="smoothing",
            action="Give a window above 0",
        )
    time, visible = tracks.time, tracks.visible
    if not visible.any():
        return tracks
    is_visible = np.broadcast_to(visible[..., None], tracks.points.shape)
    is_known = np.isfinite(tracks.sigma)
    if (tracks.sigma[is_visible & is_known] <= 0).any():
        raise CaptureError(
            "the tracks have standard deviations that are not above 0",
            code="not-positive",
            where="smoothing",
            action="Correct the tracks' sigma, or set it to nan",
        )
    has_sigma = np.asarray((is_known | ~is_visible).all(axis=(0, 2)))[:, None]
    variance = np.where(is_visible & has_sigma, tracks.sigma, 1.0) ** 2
    points, sigma_ratio = tracks.points.copy(), np.ones(is_visible.shape)
    count = _fit_parabolas(
        tracks.time, tracks.points, variance, visible, window / 2, points, sigma_ratio
    )
    if not count:
        raise CaptureError(
            f"no {MIN_WINDOW_POINTS} points of a marker are within {window:g} s; frames are"
            f" {np.median(np.diff(time)) if len(time) > 1 else np.nan:.3g} s apart",
            code="window-too-short",
            where="smoothing",
            action="Give a longer window",
        )
    return replace(
        tracks, points=points, sigma=np.where(has_sigma, tracks.sigma * sigma_ratio, np.nan)
    )


@compiled()
def _fit_parabolas(time, points, variance, visible, half, out, sigma_ratio):  # type: ignore[no-untyped-def]
    """Write the fits, and the ratios of their sigma to the points'; return how many there are."""
    fitted = 0
    S, V, T = np.empty(5), np.empty(5), np.empty(3)
    for m in range(points.shape[1]):
        for axis in range(3):
            start = 0
            for t in range(len(time)):
                if not visible[t, m]:
                    continue
                while time[start] <= time[t] - half:
                    start += 1
                S[:], V[:], T[:] = 0.0, 0.0, 0.0
                count = 0
                for i in range(start, len(time)):
                    u = (time[i] - time[t]) / half
                    kernel = 1 - u * u
                    if u >= 1:
                        break
                    if kernel <= 0 or not visible[i, m]:
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
                if count < MIN_WINDOW_POINTS or not det > MIN_DETERMINANT * S[0] * S[2] * S[4]:
                    continue
                out[t, m, axis] += (a0 * T[0] + a1 * T[1] + a2 * T[2]) / det
                spread = a0 * a0 * V[0] + 2 * a0 * a1 * V[1] + (a1 * a1 + 2 * a0 * a2) * V[2]
                spread += 2 * a1 * a2 * V[3] + a2 * a2 * V[4]
                sigma_ratio[t, m, axis] = min(1.0, math.sqrt(max(0.0, spread)) / det)
                fitted += 1
    return fitted
