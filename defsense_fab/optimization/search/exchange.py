"""Replace one cord of a layout at a time by a better candidate."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...core.curve import sample_path
from ..problem.problem import Problem
from .candidates import Pool
from .starting_layouts import Layout, keeps_clearance

_MAX_TRIES = 200  # best candidates for a cord, whose clearance is checked


def exchanged_layouts(
    problem: Problem, layout: Layout, pool: Pool, per_cord: int = 2
) -> Iterator[Layout]:
    """Yield layouts with one cord in space replaced by a candidate, the best first.

    The other cords are where descents have moved them, so a candidate can be better beside them
    than those the search started from.

    Args:
        problem: The problem.
        layout: The layout.
        pool: The candidates for every cord.
        per_cord: Largest number of layouts for each cord.
    """
    signals = np.stack([problem.signals(sample_path(s)) for s in layout], axis=1)
    paths = [Pool.of(problem, s).paths[0] for s in layout]
    found: list[tuple[float, int, int]] = []
    for i, sensor in enumerate(layout):
        if not sensor.free.issuperset({"path", "ends"}):
            continue
        sets = np.repeat(signals[None], len(pool), axis=0)
        sets[:, :, i] = pool.signals.T
        errors = problem.expected_error(sets)
        others = [p for k, p in enumerate(paths) if k != i]
        best = np.argsort(errors, kind="stable")[:_MAX_TRIES].tolist()
        kept = [
            k
            for k in best
            if all(keeps_clearance(pool.paths[k], p, problem.limits) for p in others)
        ]
        found += [(float(errors[k]), i, k) for k in kept[:per_cord]]
    for _, i, k in sorted(found):
        new = pool.sensor(k, layout[i].name, layout[i].free)
        yield tuple(new if n == i else s for n, s in enumerate(layout))
