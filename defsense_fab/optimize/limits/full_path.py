"""A cord's samples with its straight runs to the surface, and how they move with its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row, copy_rows
from ..problem.cord_kinematics import PlacedCord

RUN = 4  # samples of a straight run to the surface


@dataclass(frozen=True)
class FullPath:
    """Samples `points` (p, 3) mm in order: the run before the path's start, the path, the run
    after its end. Runs of `runs` (2,) mm follow the path's end tangents; a run of no length has
    no samples."""

    points: Float
    placed: PlacedCord
    runs: Float

    @classmethod
    def of(cls, placed: PlacedCord, runs: Float) -> FullPath:
        """The cord with runs of so many mm."""
        return cls(_with_runs(placed.points, runs), placed, runs)

    def add_rows(self, samples: Int, directions: Float, out: Float) -> None:
        """Add to out (q, size) the derivatives of how far the samples (q,) move along the
        directions (q, 3)."""
        rows, on, along = _on_path(samples, directions, self.runs, self.placed.points)
        self.placed.add_moves(rows, on, along, out)


@compiled()
def _with_runs(path, runs):  # type: ignore[no-untyped-def]
    a, b = RUN * (runs[0] > 0), RUN * (runs[1] > 0)
    count = len(path)
    out = np.empty((a + count + b, 3))
    copy_rows(path, out[a : a + count])
    for end, before, number, length in ((0, 1, a, runs[0]), (count - 1, count - 2, b, runs[1])):
        if number:
            step = path[end] - path[before]
            step *= length / np.sqrt((step**2).sum()) / RUN
            for k in range(number):
                at = a - 1 - k if end == 0 else a + count + k
                copy_row(path[end] + (k + 1) * step, out[at])
    return out


@compiled()
def _on_path(samples, directions, runs, path):  # type: ignore[no-untyped-def]
    """What moves the samples (q,) along the directions (q, 3), told by the path's own samples:
    which of the q (m,), the path's sample (m,), its direction (m, 3)."""
    a, count = RUN * (runs[0] > 0), len(path)
    rows, on = np.empty(2 * len(samples), np.int64), np.empty(2 * len(samples), np.int64)
    along = np.empty((2 * len(samples), 3))
    m = 0
    for q in range(len(samples)):
        i = samples[q] - a
        if 0 <= i < count:
            rows[m], on[m] = q, i
            copy_row(directions[q], along[m])
            m += 1
            continue
        # A run's sample turns with the path's last step.
        if i < 0:
            end, before, s = 0, 1, -i * runs[0] / RUN
        else:
            end, before, s = count - 1, count - 2, (i - count + 1) * runs[1] / RUN
        step = path[end] - path[before]
        size = np.sqrt((step**2).sum())
        step /= size
        across = (directions[q] - step * (step * directions[q]).sum()) * s / size
        rows[m], on[m], rows[m + 1], on[m + 1] = q, end, q, before
        copy_row(directions[q] + across, along[m])
        copy_row(-across, along[m + 1])
        m += 2
    return rows[:m], on[:m], along[:m]
