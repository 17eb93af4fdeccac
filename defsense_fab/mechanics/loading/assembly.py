"""Assemble the tangents of tets into a sparse matrix by the unknowns that move their nodes.

The unknowns of one node or handle are consecutive and form a group, so that the pattern of the
matrix is found quickly from the pattern of the groups.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...core.arrays import Bool, Int
from ...core.machine.compiled import compiled
from ..elements.tet10 import element_tangent


class Places(NamedTuple):
    """Where the unknowns of m tets' nodes are in the matrix, for compiled loops.

    Attributes:
        cells: (m, 10) nodes of the tets.
        special: (n,) bool, whether a node has other unknowns than its three coordinates.
        local: (n, 6) number of each unknown within its group, -1 for none.
        group: (n,) group of each node, -1 for none.
        start: (g + 1,) number of the first unknown of each group.
        size: (g,) number of unknowns of each group.
        offset: (m, 10, 10) offset of the second node's group in the rows of the first node's.
        indptr: Starts of the matrix's rows.
    """

    cells: Int
    special: Bool
    local: Int
    group: Int
    start: Int
    size: Int
    offset: Int
    indptr: Int


def find_places(
    cells: Int, special: Bool, local: Int, group: Int, start: Int, size: Int
) -> tuple[Places, Int]:
    """Find the sparsity pattern of the matrix; see `Places` for the arguments.

    Returns:
        The places, and the columns of all stored entries.
    """
    groups = group[cells]
    rows, columns = np.repeat(groups, 10, axis=1).ravel(), np.tile(groups, (1, 10)).ravel()
    keep = (rows >= 0) & (columns >= rows)
    count = len(size)
    graph = sp.csr_matrix(
        (np.ones(keep.sum(), np.int8), (rows[keep], columns[keep])), shape=(count, count)
    )
    graph.sum_duplicates()
    graph.data[:] = 1
    # A group that no active tet touches would leave an empty row.
    graph = (graph + sp.eye(count, dtype=np.int8, format="csr")).tocsr()
    graph.sort_indices()
    indptr, indices = _expand_pattern(graph.indptr, graph.indices, start, size)
    offset = _pair_offsets(groups, graph.indptr, graph.indices, size)
    return Places(cells, special, local, group, start, size, offset, indptr), indices


@compiled()
def _expand_pattern(indptr, indices, start, size):  # type: ignore[no-untyped-def]
    """Expand the pattern of groups (upper, diagonal first in a row) to that of the unknowns."""
    total = start[-1]
    out = np.zeros(total + 1, np.int32)
    for g in range(len(size)):
        width = 0
        for k in range(indptr[g], indptr[g + 1]):
            if indices[k] != g:
                width += size[indices[k]]
        for i in range(size[g]):
            out[start[g] + i + 1] = width + size[g] - i
    out = np.cumsum(out).astype(np.int32)
    columns = np.empty(out[-1], np.int32)
    for g in range(len(size)):
        for i in range(size[g]):
            at = out[start[g] + i]
            for c in range(start[g] + i, start[g] + size[g]):
                columns[at] = c
                at += 1
            for k in range(indptr[g], indptr[g + 1]):
                h = indices[k]
                if h != g:
                    for c in range(start[h], start[h] + size[h]):
                        columns[at] = c
                        at += 1
    return out, columns


@compiled()
def _pair_offsets(groups, indptr, indices, size):  # type: ignore[no-untyped-def]
    """Return offsets (m, 10, 10) of the second node's group in the rows of the first node's."""
    before = np.zeros(len(indices), np.int32)
    for g in range(len(size)):
        at = 0
        for k in range(indptr[g], indptr[g + 1]):
            before[k] = at
            if indices[k] != g:
                at += size[indices[k]]
    out = np.zeros((len(groups), 10, 10), np.int32)
    for e in range(len(groups)):
        for a in range(10):
            g = groups[e, a]
            if g < 0:
                continue
            for b in range(10):
                if groups[e, b] > g:
                    low, high = indptr[g], indptr[g + 1]
                    while high - low > 1:
                        middle = (low + high) // 2
                        if indices[middle] <= groups[e, b]:
                            low = middle
                        else:
                            high = middle
                    out[e, a, b] = before[low]
    return out


@compiled()
def assemble_tangents(elements, law, share, first, places, basis, data):  # type: ignore[no-untyped-def]
    """Add the tangents of the tets from number `first` on to the entries `data` of the matrix.

    `elements` holds their gradients, shape gradients, weights and pressure differences.
    """
    F, gradient, weight, lag = elements
    kind, p = law
    cells, special, local, group, start, size, offset, indptr = places
    K, H, T = np.empty((30, 30)), np.empty((9, 9)), np.empty((9, 30))
    block = np.empty((6, 6))
    half = np.empty((3, 6))
    for k in range(len(F)):
        e = first + k
        element_tangent(F[k], gradient[k], weight[k], kind, p, lag[k], share, K, H, T)
        for a in range(10):
            na = cells[e, a]
            g = group[na]
            if g < 0:
                continue
            for b in range(10):
                nb = cells[e, b]
                h = group[nb]
                if h < g:
                    continue
                shift = size[g] + offset[e, a, b]
                if not special[na] and not special[nb]:
                    for i in range(3):
                        row = indptr[start[g] + i]
                        if g == h:
                            for j in range(i, 3):
                                data[row + j - i] += K[3 * a + i, 3 * b + j]
                        else:
                            row += shift - i
                            for j in range(3):
                                data[row + j] += K[3 * a + i, 3 * b + j]
                    continue
                for i in range(3):
                    for d in range(6):
                        half[i, d] = 0.0
                        if local[nb, d] >= 0:
                            for j in range(3):
                                half[i, d] += K[3 * a + i, 3 * b + j] * basis[nb, j, d]
                for c in range(6):
                    if local[na, c] < 0:
                        continue
                    for d in range(6):
                        block[c, d] = 0.0
                        for i in range(3):
                            block[c, d] += basis[na, i, c] * half[i, d]
                for c in range(6):
                    i = local[na, c]
                    if i < 0:
                        continue
                    row = indptr[start[g] + i]
                    for d in range(6):
                        j = local[nb, d]
                        if j < 0:
                            continue
                        if g != h:
                            data[row + shift - i + j] += block[c, d]
                        elif j >= i:
                            data[row + j - i] += block[c, d]
