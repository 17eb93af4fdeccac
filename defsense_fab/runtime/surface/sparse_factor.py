"""A sparse symmetric matrix, factored once, and solved for three right sides many times.

SuperLU makes the factor L D L^T; columns of L with nearly the same rows are stored as one dense
block (supernodes), so that a solve reads its memory in order and in one go.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import splu

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled

# An order of elimination for meshes: nested dissection by coordinates.
#
# A. George, "Nested dissection of a regular finite element mesh", SIAM J. Numer. Anal. 10 (1973): the
# vertices that part a set in halves come last, each half is ordered in the same way. Cuts are planes
# across the set's longest extents, of which that with the smallest separator is taken.

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


_PADDING = 0.3  # of a block's entries that may be zeros
_SLACK = 16  # zeros that a small block may have besides
_WIDEST = 64  # columns of a block


@dataclass(frozen=True)
class SparseFactor:
    """`order` (n,) is the row of the matrix that stands at each place of a right side; blocks of
    columns begin at `start` (k + 1,), their rows below are `rows` from `row_at` (k + 1,) on, their
    entries `values` from `value_at` (k + 1,) on, column by column, each from the block's first row
    on; `inverse` (n,) of the diagonal D."""

    order: Int
    start: Int
    row_at: Int
    rows: Int
    value_at: Int
    values: Float
    inverse: Float

    @classmethod
    def of(cls, matrix: csr_array, order: Int) -> SparseFactor:
        """Of a symmetric positive definite matrix (n, n), eliminated about in this order (n,)."""
        permuted = matrix[order][:, order].tocsc()
        lu = splu(permuted, permc_spec="NATURAL", diag_pivot_thresh=0.0,
                  options={"SymmetricMode": True})  # fmt: skip
        lower = (lu.L - eye_array(len(order), format="csc")).tocsc()
        lower.eliminate_zeros()
        lower.sort_indices()
        place = np.empty(len(order), np.int64)
        place[lu.perm_c] = order
        ptr, rows, values = lower.indptr.astype(np.int64), lower.indices, lower.data
        start = _blocks(ptr, rows)
        row_at, packed_rows, value_at, packed = _pack(ptr, rows, values, start)
        inverse = 1.0 / lu.U.diagonal()
        return cls(place, start, row_at, packed_rows, value_at, packed, inverse)

    def solve(self, right: Float) -> None:
        """In place, of right sides (3, n), whose entries stand in the factor's order."""
        _solve(
            self.start, self.row_at, self.rows, self.value_at, self.values, self.inverse, right
        )  # fmt: skip


@compiled()
def _blocks(ptr: Int, rows: Int) -> Int:
    """(k + 1,) where blocks of columns begin: a column joins the one before, whose first row it is,
    while the zeros that have to be stored are few."""
    n = len(ptr) - 1
    start = np.empty(n + 1, np.int64)
    start[0], count = 0, 1
    for j in range(1, n):
        first, width = start[count - 1], j + 1 - start[count - 1]
        if ptr[j] > ptr[j - 1] and rows[ptr[j - 1]] == j and width <= _WIDEST:
            full, have = width * (ptr[j + 1] - ptr[j]), 0
            for p in range(ptr[first], ptr[j + 1]):
                have += rows[p] > j
            if full - have <= _PADDING * full + _SLACK:
                continue
        start[count] = j
        count += 1
    start[count] = n
    return start[: count + 1].copy()


@compiled()
def _pack(ptr: Int, rows: Int, values: Float, start: Int) -> tuple[Int, Int, Int, Float]:
    blocks = len(start) - 1
    row_at, value_at = np.zeros(blocks + 1, np.int64), np.zeros(blocks + 1, np.int64)
    for s in range(blocks):
        width, below = start[s + 1] - start[s], ptr[start[s + 1]] - ptr[start[s + 1] - 1]
        row_at[s + 1] = row_at[s] + below
        value_at[s + 1] = value_at[s] + width * (width + below)
    packed_rows, packed = np.zeros(row_at[blocks], np.uint32), np.zeros(value_at[blocks])
    for s in range(blocks):
        first, end = start[s], start[s + 1]
        width = end - first
        # Columns of a block have no rows that its last one has not: it is an ancestor of all.
        packed_rows[row_at[s] : row_at[s + 1]] = rows[ptr[end - 1] : ptr[end]]
        height = width + row_at[s + 1] - row_at[s]
        for j in range(first, end):
            q, column = row_at[s], value_at[s] + (j - first) * height
            for p in range(ptr[j], ptr[j + 1]):
                r = rows[p]
                line = r - first
                if r >= end:
                    while packed_rows[q] != r:
                        q += 1
                    line = width + q - row_at[s]
                packed[column + line] = values[p]
    return row_at, packed_rows, value_at, packed


@compiled(error_model="numpy", fastmath=True)
def _solve(
    start: Int, row_at: Int, rows: Int, value_at: Int, values: Float, inverse: Float, right: Float
) -> None:  # fmt: skip
    x, y, z = right[0], right[1], right[2]
    blocks = len(start) - 1
    tallest = 0
    for s in range(blocks):
        tallest = max(tallest, row_at[s + 1] - row_at[s])
    below = np.empty((3, tallest))
    b0, b1, b2 = below[0], below[1], below[2]
    for s in range(blocks):
        a, width, at = start[s], start[s + 1] - start[s], value_at[s]
        # Views, whose indices count from 0: these loops are what is done at once.
        own, u, v, w = rows[row_at[s] : row_at[s + 1]], x[a:], y[a:], z[a:]
        height = len(own)
        b0[:height] = 0.0
        b1[:height] = 0.0
        b2[:height] = 0.0
        for j in range(width):
            t0, t1, t2 = u[j], v[j], w[j]
            column = values[at : at + width]
            for i in range(j + 1, width):
                u[i] -= column[i] * t0
                v[i] -= column[i] * t1
                w[i] -= column[i] * t2
            column = values[at + width : at + width + height]
            for p in range(height):
                b0[p] += column[p] * t0
                b1[p] += column[p] * t1
                b2[p] += column[p] * t2
            at += width + height
        for p in range(height):
            x[own[p]] -= b0[p]
            y[own[p]] -= b1[p]
            z[own[p]] -= b2[p]
    for s in range(blocks - 1, -1, -1):
        a, width, at = start[s], start[s + 1] - start[s], value_at[s + 1]
        own, u, v, w = rows[row_at[s] : row_at[s + 1]], x[a:], y[a:], z[a:]
        height = len(own)
        for p in range(height):
            b0[p], b1[p], b2[p] = x[own[p]], y[own[p]], z[own[p]]
        for j in range(width - 1, -1, -1):
            t0, t1, t2 = 0.0, 0.0, 0.0
            column = values[at - height : at]
            for p in range(height):
                t0 += column[p] * b0[p]
                t1 += column[p] * b1[p]
                t2 += column[p] * b2[p]
            at -= width + height
            column = values[at : at + width]
            for i in range(j + 1, width):
                t0 += column[i] * u[i]
                t1 += column[i] * v[i]
                t2 += column[i] * w[i]
            d = inverse[a + j]
            u[j], v[j], w[j] = u[j] * d - t0, v[j] * d - t1, w[j] * d - t2
