"""Greedy selection with swaps: one candidate from each cord's pool."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ...core.arrays import Bool, Float, Int
from ..limits.polyline_distance import gaps
from .candidates import Pool

#: So many of the best are tried in place of a cord that there is; for a new one all are.
_TRIES = 400


def select(
    pools: Sequence[Pool],
    error: Callable[[Float], Float],
    clearance: float,
    *,
    rounds: int = 3,
    some: Sequence[Bool] | None = None,
    settled: Sequence[bool] | None = None,
    allowed: Callable[[dict[int, int]], bool] | None = None,
) -> Int:
    """Index into each pool (m,), -1 for those left when no clear candidate was found for one.

    `error` takes sets of signals (k, n, m) to the error of each (k,), for any number m of cords.
    Cords are added one by one, then exchanged one by one while that helps. `some` restricts each
    pool to a part; `allowed` may refuse what is chosen so far, pool by pool. `settled`
    pools have one candidate, a cord that was verified beside the others of these: what is asked
    here is more, for the sake of coarse samples, and is not asked of two of them.
    """
    stays = settled or [False] * len(pools)
    chosen = np.full(len(pools), -1)
    order = sorted(range(len(pools)), key=lambda i: len(pools[i]))
    for turn in range(rounds + 1):
        before = chosen.copy()
        for slot in order:
            pool = pools[slot]
            others = [i for i in range(len(pools)) if i != slot and chosen[i] >= 0]
            which = np.arange(len(pool)) if some is None else np.flatnonzero(some[slot])
            own = pool.signals.T[which]
            rest = [np.broadcast_to(pools[i].signals[:, chosen[i]], own.shape) for i in others]
            errors = error(np.stack([own, *rest], axis=-1))
            lines = [pools[i].paths[chosen[i]] for i in others if not (stays[slot] and stays[i])]
            best = np.argsort(errors, kind="stable")[: _TRIES if chosen[slot] >= 0 else None]
            for k in which[best].tolist():
                if k == chosen[slot]:
                    break  # better ones are not clear
                if all(_clear(pool.paths[k], line, clearance) for line in lines) and (
                    allowed is None or allowed({**{i: int(chosen[i]) for i in others}, slot: k})
                ):
                    chosen[slot] = k
                    break
            else:
                if chosen[slot] < 0:
                    return chosen
        if turn and (before == chosen).all():
            break
    return chosen


def _clear(path: Float, other: Float, clearance: float) -> bool:
    """Whether the path (p, 3) keeps `clearance` from the path (q, 3)."""
    slack = np.linalg.norm(np.diff(other, axis=0), axis=1).max() / 4
    low, high = other.min(0) - clearance - slack, other.max(0) + clearance + slack
    if (path.max(0) < low).any() or (path.min(0) > high).any():
        return True
    return bool(gaps(path[None], other)[0] >= clearance + slack)
