"""A cord's samples with its straight runs to the surface, and how they move with its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from ..core.arrays import Float, Int
from .freedom import CordFreedom

RUN = 4  # samples of a straight run to the surface


@dataclass(frozen=True)
class Track:
    """Samples `points` (p, 3) mm in order: the run before the path's start, the path, the run
    after its end. Runs of `runs` (2,) mm follow the path's end tangents; a run of no length has
    no samples. `motion` is what moves the path's samples, see `CordFreedom.motion`."""

    points: Float
    path: Float
    runs: Float
    motion: tuple[Float, Float, Float, Float, Float]

    @classmethod
    def of(cls, cord: CordFreedom, x: Float, runs: Float) -> Track:
        """The cord at parameters x (size,)."""
        path, motion = cord.motion(x)
        return cls(_with_runs(path, runs), path, runs, motion)

    def add_rows(self, samples: Int, directions: Float, out: Float) -> None:
        """Add to out (q, size) the derivatives of how far the samples (q,) move along the
        directions (q, 3)."""
        if out.shape[1]:
            _add_rows(samples, directions, self.runs, self.path, *self.motion, out)


@numba.njit(cache=True, nogil=True)
def _with_runs(path, runs):  # type: ignore[no-untyped-def]
    a, b = RUN * (runs[0] > 0), RUN * (runs[1] > 0)
    count = len(path)
    out = np.empty((a + count + b, 3))
    out[a : a + count] = path
    for end, before, number, length in ((0, 1, a, runs[0]), (count - 1, count - 2, b, runs[1])):
        if number:
            step = path[end] - path[before]
            step *= length / np.sqrt((step**2).sum()) / RUN
            for k in range(number):
                at = a - 1 - k if end == 0 else a + count + k
                out[at] = path[end] + (k + 1) * step
    return out


@numba.njit(cache=True, nogil=True)
def _add_rows(  # type: ignore[no-untyped-def]
    samples, directions, runs, path, basis, axes, moves, turns, local, out
):
    a, count = RUN * (runs[0] > 0), len(path)
    for q in range(len(samples)):
        i, u = samples[q] - a, directions[q]
        if 0 <= i < count:
            _add(i, u, basis, axes, moves, turns, local, out[q])
            continue
        # A run's sample turns with the path's last step.
        if i < 0:
            end, before, s = 0, 1, -i * runs[0] / RUN
        else:
            end, before, s = count - 1, count - 2, (i - count + 1) * runs[1] / RUN
        step = path[end] - path[before]
        size = np.sqrt((step**2).sum())
        step /= size
        across = (u - step * (step * u).sum()) * s / size
        _add(end, u + across, basis, axes, moves, turns, local, out[q])
        _add(before, -across, basis, axes, moves, turns, local, out[q])


@numba.njit(cache=True, nogil=True)
def _add(i, u, basis, axes, moves, turns, local, out):  # type: ignore[no-untyped-def]
    x = u[0] * axes[0, 0] + u[1] * axes[1, 0] + u[2] * axes[2, 0]
    y = u[0] * axes[0, 1] + u[1] * axes[1, 1] + u[2] * axes[2, 1]
    rows = basis.shape[1]
    for r in range(rows):
        w = basis[i, r]
        if w != 0.0:
            out[2 * r] += w * x
            out[2 * r + 1] += w * y
    if len(turns):
        for d in range(3):
            for m in range(2):
                out[2 * rows + m] += u[d] * moves[m, d]
            for t in range(3):
                moved = turns[t, d, 0] * local[i, 0] + turns[t, d, 1] * local[i, 1]
                out[2 * rows + 2 + t] += u[d] * moved
