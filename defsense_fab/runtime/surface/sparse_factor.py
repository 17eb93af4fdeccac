"""Factor a sparse symmetric matrix once, and solve for three right sides many times.

SuperLU orders the rows by minimum degree and computes the factor L D L^T. Columns of L with nearly
the same rows are stored as one dense block (supernode), so that a solve reads its memory
sequentially: that takes about half the time of SuperLU's own solve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import splu

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled

_MAX_ZERO_SHARE = 0.3  # of a block's entries
_FREE_ZEROS = 16  # additional zeros that a small block may store
_MAX_BLOCK_COLUMNS = 64


@dataclass(frozen=True)
class SparseFactor:
    """The factor L D L^T of a matrix, in blocks of columns.

    Attributes:
        order: Row of the matrix at each position of a right side (n,).
        start: First column of each of k blocks, and n (k + 1,).
        row_at: Start of each block's rows below the block in `rows` (k + 1,).
        rows: Rows below the blocks.
        value_at: Start of each block's entries in `values` (k + 1,).
        values: Entries, column by column, each column from the block's first row on.
        inverse: Inverse of the diagonal D (n,).
    """

    order: Int
    start: Int
    row_at: Int
    rows: Int
    value_at: Int
    values: Float
    inverse: Float

    @classmethod
    def of(cls, matrix: csr_array) -> SparseFactor:
        """Factor a symmetric positive definite matrix (n, n)."""
        lu = splu(
            matrix.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        lower = (lu.L - eye_array(matrix.shape[0], format="csc")).tocsc()
        lower.eliminate_zeros()
        lower.sort_indices()
        order = np.argsort(lu.perm_c)
        ptr, rows, values = lower.indptr.astype(np.int64), lower.indices, lower.data
        start = _blocks(ptr, rows)
        row_at, packed_rows, value_at, packed = _pack(ptr, rows, values, start)
        inverse = 1.0 / lu.U.diagonal()
        return cls(order, start, row_at, packed_rows, value_at, packed, inverse)

    def solve(self, right: Float) -> None:
        """Solve in place for three right sides (3, n), permuted to the factor's order."""
        _solve(self.start, self.row_at, self.rows, self.value_at, self.values, self.inverse, right)


@compiled()
def _blocks(ptr: Int, rows: Int) -> Int:
    """Return the first column of each block, and n (k + 1,).

    A column joins the one before, whose first row it is, while few zeros have to be stored.
    """
    n = len(ptr) - 1
    start = np.empty(n + 1, np.int64)
    start[0], count = 0, 1
    for j in range(1, n):
        first, width = start[count - 1], j + 1 - start[count - 1]
        if ptr[j] > ptr[j - 1] and rows[ptr[j - 1]] == j and width <= _MAX_BLOCK_COLUMNS:
            entries, nonzeros = width * (ptr[j + 1] - ptr[j]), 0
            for p in range(ptr[first], ptr[j + 1]):
                nonzeros += rows[p] > j
            if entries - nonzeros <= _MAX_ZERO_SHARE * entries + _FREE_ZEROS:
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
        # The last column of a block has all rows of the others: it is an ancestor of them.
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
) -> None:
    x, y, z = right[0], right[1], right[2]
    blocks = len(start) - 1
    tallest = 0
    for s in range(blocks):
        tallest = max(tallest, row_at[s + 1] - row_at[s])
    below = np.empty((3, tallest))
    b0, b1, b2 = below[0], below[1], below[2]
    for s in range(blocks):
        a, width, at = start[s], start[s + 1] - start[s], value_at[s]
        # Views with indices from 0 let these loops be vectorized.
        below_rows, u, v, w = rows[row_at[s] : row_at[s + 1]], x[a:], y[a:], z[a:]
        height = len(below_rows)
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
            x[below_rows[p]] -= b0[p]
            y[below_rows[p]] -= b1[p]
            z[below_rows[p]] -= b2[p]
    for s in range(blocks - 1, -1, -1):
        a, width, at = start[s], start[s + 1] - start[s], value_at[s + 1]
        below_rows, u, v, w = rows[row_at[s] : row_at[s + 1]], x[a:], y[a:], z[a:]
        height = len(below_rows)
        for p in range(height):
            b0[p], b1[p], b2[p] = x[below_rows[p]], y[below_rows[p]], z[below_rows[p]]
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
