"""Greedy selection with swaps: one candidate from each cord's pool."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..core.arrays import Bool, Float, Int
from .candidates import Pool
from .nearest import gaps


def select(
    pools: Sequence[Pool],
    error: Callable[[Float], Float],
    clearance: float,
    rounds: int = 3,
) -> Int | None:
    """Index into each pool (m,), or None where no clear combination was found.

    `error` takes sets of signals (k, n, m) to the error of each (k,), for any number m of cords.
    Cords are added one by one, then exchanged one by one while that helps.
    """
    chosen = np.full(len(pools), -1)
    order = sorted(range(len(pools)), key=lambda i: len(pools[i].sensors))
    for turn in range(rounds + 1):
        before = chosen.copy()
        for slot in order:
            others = [i for i in range(len(pools)) if i != slot and chosen[i] >= 0]
            clear = np.ones(len(pools[slot].sensors), bool)
            for i in others:
                clear &= _clear(pools[slot].paths, pools[i].paths[chosen[i]], clearance)
            if not clear.any():
                if turn == 0:
                    return None
                continue
            which = np.flatnonzero(clear)
            own = pools[slot].signals.T[which]
            rest = [np.broadcast_to(pools[i].signals[:, chosen[i]], own.shape) for i in others]
            chosen[slot] = which[error(np.stack([own, *rest], axis=-1)).argmin()]
        if (before == chosen).all():
            break
    return chosen


def _clear(paths: Float, other: Float, clearance: float) -> Bool:
    """Which of the paths (c, p, 3) keep `clearance` from the path (q, 3)."""
    slack = np.linalg.norm(np.diff(other, axis=0), axis=1).max() / 4
    low, high = other.min(0) - clearance - slack, other.max(0) + clearance + slack
    out = np.ones(len(paths), bool)
    near = ((paths.max(1) >= low) & (paths.min(1) <= high)).all(1)
    out[near] = gaps(paths[near], other) >= clearance + slack
    return out
