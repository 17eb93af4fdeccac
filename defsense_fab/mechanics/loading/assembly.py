"""Assemble the tangents of tets into a sparse matrix by the unknowns that move their nodes.

The unknowns of one node or handle are consecutive and form a group, so that the pattern of the
matrix is found quickly from the pattern of the groups.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ...core.arrays import Bool, Float, Int
from ...core.machine import kernels


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
    pattern = (graph.indptr.astype(np.int32), graph.indices.astype(np.int32))
    indptr: Any = np.empty(start[-1] + 1, np.int32)
    kernels.expand_rows(pattern, start, size, indptr)
    indices = np.empty(indptr[-1], np.int32)
    kernels.expand_columns(pattern, start, size, indptr, indices)
    offset: Any = np.empty((len(groups), 10, 10), np.int32)
    kernels.pair_offsets(groups, pattern, size, offset)
    return Places(cells, special, local, group, start, size, offset, indptr), indices


def assemble_tangents(
    elements: tuple[Float, Float, Float, Float],
    law: tuple[int, Float],
    share: float,
    places: Places,
    first: int,
    basis: Float,
    data: Float,
) -> None:
    """Add the tangents of k tets to the entries of the matrix.

    Args:
        elements: Gradients (k, 4, 3, 3), shape gradients (k, 4, 10, 3), weights (k,) and pressure
            differences (k, 4) of the tets; see `energy_density.tangent`.
        law: The material's `law`.
        share: Share of the tangent's negative part that is removed.
        places: Where the unknowns are in the matrix.
        first: Number of the first of the tets.
        basis: Derivatives (n, 3, 6) of the nodes' positions by their unknowns.
        data: Stored entries of the matrix, changed in place.
    """
    kernels.assemble_tangents(elements, law, share, places, first, basis, data)
