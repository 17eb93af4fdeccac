"""Which of many candidates keep wall, radius and distance from themselves, on coarse samples."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.curve import curvature
from ...core.curve import arc_lengths
from ...geometry.kernels.signed_distance import SignedDistance
from ..limits.constraints import LONGEST_INLET, MARGIN, depth_before_exit, run_lengths, separation
from ..limits.full_path import RUN
from ..limits.polyline_distance import self_gaps
from ..problem.depth_grid import DepthGrid
from ..problem.problem import Limits
from .candidate_batch import COARSE, Batch


def feasible(batch: Batch, depth: SignedDistance, grid: DepthGrid, limits: Limits) -> Int:
    """Indices of the candidates that keep the limits."""
    kept = np.arange(len(batch))

    def narrow(good: Bool) -> None:
        nonlocal batch, kept
        batch, kept = batch.take(np.flatnonzero(good)), kept[good]

    bend = np.abs(curvature(batch.points, batch.tangents, 6)).max(axis=1)
    narrow(np.asarray(bend * limits.min_radius < 0.98))
    for count in (8, COARSE):  # most fail at a few points already
        narrow(np.asarray(grid(batch.paths(count)).min(axis=1) > 0))
    paths, out = batch.paths(COARSE), batch.out()
    ends = np.stack(
        [
            grid.exits(paths[:, 0], out[:, 0], LONGEST_INLET - 1),
            grid.exits(paths[:, -1], out[:, 1], LONGEST_INLET - 1),
        ],
        axis=1,
    )
    leaves = np.asarray(np.isfinite(ends).all(axis=1))
    narrow(leaves)
    if not len(kept):
        return kept
    ends = ends[leaves]
    whole = _with_runs(paths[leaves], out[leaves], run_lengths(ends))
    along = arc_lengths(whole)
    rest = ends - run_lengths(ends)
    to_exit = np.minimum(along + rest[:, :1], along[:, -1:] - along + rest[:, 1:])
    need, _ = depth_before_exit(to_exit, limits)
    found = grid(whole)
    good = np.asarray((found - need).min(axis=1) >= -grid.error)
    length = along[:, -1] + rest.sum(axis=1)
    good &= (length > limits.shortest + MARGIN) & (length < limits.longest - MARGIN)
    close = good[:, None] & (found - need < grid.error)
    found[close] = depth(whole[close])
    good &= (found >= need).all(axis=1)
    good[good] = self_gaps(whole[good], separation(limits)) >= (
        limits.clearance + np.diff(along[good]).max(axis=1) / 4
    )
    return np.asarray(kept[good])


def _with_runs(paths: Float, out: Float, runs: Float) -> Float:
    """Paths (c, p, 3) with samples of their straight runs of `runs` (c, 2) mm along `out`
    (c, 2, 3)."""
    s = (np.arange(RUN) + 1)[:, None] / RUN
    start = paths[:, :1] + (runs[:, 0, None, None] * s) * out[:, None, 0]
    end = paths[:, -1:] + (runs[:, 1, None, None] * s) * out[:, None, 1]
    return np.concatenate([start[:, ::-1], paths, end], axis=1)
