"""Places that a marker cannot have come to: swapped numbers, flips, false detections.

A hand moves things with limited acceleration. Of each marker the longest chain of places is kept in
which each can be reached from the one before: what does not belong to it is taken out (longest path
by dynamic programming, so that a wrong beginning does not throw away what follows).
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Bool, Float

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
