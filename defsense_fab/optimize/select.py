"""Greedy selection with swaps: one candidate from each cord's pool."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.arrays import Bool, Float, Int
from .candidates import Pool
from .nearest import gaps


def select(
    pools: Sequence[Pool], outputs: Float, ridge: float, clearance: float, rounds: int = 3
) -> Int | None:
    """Index into each pool (m,), or None where no clear combination was found.

    `outputs` (n, r) are centred. With A = (I + S S^T / ridge)^-1 the expected squared error is
    tr(O^T A O), and one more signal s lowers it by |O^T A s|^2 / (ridge + s^T A s).
    """
    centred = [p.signals - p.signals.mean(0) for p in pools]
    chosen = np.full(len(pools), -1)
    order = sorted(range(len(pools)), key=lambda i: len(pools[i].sensors))
    for turn in range(rounds + 1):
        before = chosen.copy()
        for slot in order:
            others = [i for i in range(len(pools)) if i != slot and chosen[i] >= 0]
            S = np.stack([centred[i][:, chosen[i]] for i in others], axis=1) if others else None
            gain = _gain(S, centred[slot], outputs, ridge)
            clear = np.ones(len(gain), bool)
            for i in others:
                clear &= _clear(pools[slot].paths, pools[i].paths[chosen[i]], clearance)
            if not clear.any():
                if turn == 0:
                    return None
                continue
            chosen[slot] = int(np.where(clear, gain, -np.inf).argmax())
        if (before == chosen).all():
            break
    return chosen


def _gain(S: Float | None, pool: Float, outputs: Float, ridge: float) -> Float:
    A: Float = np.eye(len(outputs))
    if S is not None:
        A = np.asarray(np.linalg.inv(A + S @ S.T / ridge), float)
    As = A @ pool
    return np.asarray(((outputs.T @ As) ** 2).sum(0) / (ridge + (pool * As).sum(0)))


def _clear(paths: Float, other: Float, clearance: float) -> Bool:
    """Which of the paths (c, p, 3) keep `clearance` from the path (q, 3)."""
    slack = np.linalg.norm(np.diff(other, axis=0), axis=1).max() / 4
    low, high = other.min(0) - clearance - slack, other.max(0) + clearance + slack
    out = np.ones(len(paths), bool)
    near = ((paths.max(1) >= low) & (paths.min(1) <= high)).all(1)
    out[near] = gaps(paths[near], other) >= clearance + slack
    return out
