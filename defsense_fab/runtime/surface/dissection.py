"""An order of elimination for meshes: nested dissection by coordinates.

A. George, "Nested dissection of a regular finite element mesh", SIAM J. Numer. Anal. 10 (1973): the
vertices that part a set in halves come last, each half is ordered in the same way. Cuts are planes
across the set's longest extents, of which that with the smallest separator is taken.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled

_LEAF = 24  # vertices; smaller sets stay as they are


def elimination_order(points: Float, ptr: Int, neighbours: Int) -> Int:
    """(n,) vertices in their order, of `points` (n, 3) with the symmetric graph `ptr` (n + 1,),
    `neighbours`."""
    order = np.empty(len(points), np.int64)
    side = np.zeros(len(points), np.int8)
    todo = [(np.arange(len(points)), 0)]
    while todo:
        inside, first = todo.pop()
        if len(inside) <= _LEAF:
            order[first : first + len(inside)] = inside
            continue
        low, high, separator = _cut(points, inside, ptr, neighbours, side)
        order[first + len(low) + len(high) : first + len(inside)] = separator
        todo += [(low, first), (high, first + len(low))]
    return order


def _cut(points: Float, inside: Int, ptr: Int, neighbours: Int, side: Any) -> tuple[Int, Int, Int]:
    x = points[inside] - points[inside].mean(axis=0)
    _, axes = np.linalg.eigh(x.T @ x)
    best: tuple[Int, Int, Int] | None = None
    for axis in (2, 1):
        along = x @ axes[:, axis]
        sorted_ = np.argsort(along, kind="stable")
        half = len(inside) // 2
        low, high = inside[sorted_[:half]], inside[sorted_[half:]]
        side[low], side[high] = 1, 2
        edge = _touches(low, ptr, neighbours, side, 2)
        other = _touches(high, ptr, neighbours, side, 1)
        if edge.sum() <= other.sum():
            found = low[~edge], high, low[edge]
        else:
            found = low, high[~other], high[other]
        if best is None or len(found[2]) < len(best[2]):
            best = found
    side[inside] = 0
    assert best is not None
    return best


@compiled()
def _touches(vertices: Int, ptr: Int, neighbours: Int, side: Any, of: int) -> Any:
    """(k,) which of these have a neighbour on a side."""
    out = np.zeros(len(vertices), np.bool_)
    for k in range(len(vertices)):
        v = vertices[k]
        for p in range(ptr[v], ptr[v + 1]):
            if side[neighbours[p]] == of:
                out[k] = True
                break
    return out
