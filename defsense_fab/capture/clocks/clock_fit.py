"""How the device's clock and the host's go together: offset, drift and delay of arrival.

Frames are late by what buffers and schedulers add, never early. So the line that relates the clocks
runs below all arrivals, as close to them as can be: the edge of their lower convex hull at the mean
time, which solves that linear program (Moon, Skelly & Towsley 1999).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float


@dataclass(frozen=True)
class Clocks:
    """host = offset + (1 + drift) device, s; `delay`, the median time by which frames arrived later
    than the earliest ones, s."""

    offset: float
    drift: float
    delay: float

    def to_host(self, device: Float) -> Float:
        """The host's time, s, at device times, s."""
        return np.asarray(self.offset + (1 + self.drift) * np.asarray(device))


def fit_clocks(device: Float, host: Float) -> Clocks:
    """From the times (t,) s of both clocks at which frames were sent and arrived; from fewer than
    two different ones no drift."""
    start, first = float(device[0]), float(host[0])
    x, y = device - start, host - first - (device - start)  # the drift alone keeps its digits
    if np.ptp(x) <= 0:
        offset = float((host - device).min())
        return Clocks(offset, 0.0, float(np.median(host - device) - offset))
    hull: list[int] = []
    for i in np.lexsort((y, x)):
        while len(hull) > 1 and _turns_right(x, y, hull[-2], hull[-1], int(i)):
            hull.pop()
        if not hull or x[i] > x[hull[-1]]:
            hull.append(int(i))
    k = int(np.clip(np.searchsorted(x[hull], x.mean()), 1, len(hull) - 1))
    a, b = hull[k - 1], hull[k]
    drift = float((y[b] - y[a]) / (x[b] - x[a]))
    offset = float(y[a] - drift * x[a])
    late = y - (offset + drift * x)
    return Clocks(first + offset - (1 + drift) * start, drift, float(np.median(late)))


def _turns_right(x: Float, y: Float, a: int, b: int, c: int) -> bool:
    return bool((x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a]) <= 0)
