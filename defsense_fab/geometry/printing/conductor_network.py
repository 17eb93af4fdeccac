"""Resistance and narrowest cross-section of touching cells of conductive beads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu

from ...core.arrays import Float, Int
from .bead_cells import ACROSS, ALONG, CELL_LENGTH_MM, LAYERS, Cells, Contacts

AREA_UNIT_MM2 = 1e-4  # of the integer capacities of the flow
#: Nodes this close to a terminal along the center line belong to it.
TERMINAL_REACH_MM = 1.5 * CELL_LENGTH_MM
_PARALLEL_COSINE = 0.9
_UNLIMITED = 10**8  # in that unit


@dataclass(frozen=True)
class Resistivity:
    """Resistivity of a printed conductor by direction, ohm mm.

    Attributes:
        along: Along beads.
        across: From bead to bead in a layer.
        layers: From layer to layer.

    Raises:
        ValueError: A value is not positive.
    """

    along: float
    across: float
    layers: float

    def __post_init__(self) -> None:
        if not min(self.along, self.across, self.layers) > 0:
            raise ValueError("resistivities must be positive")


@dataclass(frozen=True)
class Neck:
    """Narrowest cross-section in a stretch of a trace.

    Attributes:
        area: Area, mm^2; 0 if nothing connects the ends of the stretch.
        point: Center (3,), mm.
    """

    area: float
    point: Float


def find_components(count: int, pair: Int) -> Int:
    """Return the number of the connected component of each of `count` cells.

    Args:
        count: Number of cells.
        pair: Pairs (m, 2) of cells that touch.
    """
    graph = sparse.coo_array(
        (np.ones(len(pair), np.int8), (pair[:, 0], pair[:, 1])), shape=(count, count)
    )
    return np.asarray(csgraph.connected_components(graph, directed=False)[1], np.int64)


@dataclass(frozen=True)
class BeadNodes:
    """Ends of cells, as nodes of a network: cells that follow each other share a node.

    Attributes:
        point: Places (k, 3), mm.
        of_cell: Nodes (n, 2) at the start and end of each cell.
    """

    point: Float
    of_cell: Int


def find_nodes(cells: Cells, number: Int) -> BeadNodes:
    """Return the nodes of some cells.

    Args:
        cells: Cells.
        number: Their numbers (n,) among all cells of the material.
    """
    key = (number + cells.chain)[:, None] + np.array([0, 1])
    unique, of_cell = np.unique(key, return_inverse=True)
    of_cell = of_cell.reshape(-1, 2)
    point = np.empty((len(unique), 3))
    half = cells.length[:, None] / 2 * cells.direction
    point[of_cell[:, 0]] = cells.center - half
    point[of_cell[:, 1]] = cells.center + half
    return BeadNodes(point, of_cell)


def solve_resistance(
    cells: Cells,
    contacts: Contacts,
    nodes: BeadNodes,
    resistivity: Resistivity,
    arc: Float,
    ends: tuple[float, float],
) -> float:
    """Return the resistance of a connected conductor, ohm.

    Potentials are linear along cells. Contacts connect the places where cells touch, so that a
    contact moves current sideways only. The nodes up to `ends[0]` and from `ends[1]` are at 1 V
    and 0 V; the resistance is scaled from the distance that the current covers to that of `ends`.

    Args:
        cells: Cells of one connected component.
        contacts: Their contacts.
        nodes: Their nodes.
        resistivity: Resistivity by direction.
        arc: Positions (k,) of the nodes along the center line, mm.
        ends: Positions of both terminals, mm.
    """
    count = len(cells)
    side = contacts.take(contacts.kind != ALONG)
    rho = np.where(side.kind == ACROSS, resistivity.across, resistivity.layers)
    share = (side.at + 1) / 2
    rows = np.repeat(np.arange(count + len(side.kind)), [2] * count + [4] * len(side.kind))
    columns = np.concatenate([nodes.of_cell.reshape(-1), nodes.of_cell[side.pair].reshape(-1)])
    weight = np.stack([1 - share[:, 0], share[:, 0], share[:, 1] - 1, -share[:, 1]], axis=1)
    values = np.concatenate([np.tile([1.0, -1.0], count), weight.reshape(-1)])
    difference = sparse.csr_array((values, (rows, columns)), shape=(rows[-1] + 1, len(arc)))
    conductance = np.concatenate(
        [cells.section / (resistivity.along * cells.length), side.area / (rho * side.distance)]
    )
    matrix = (difference.T @ sparse.diags_array(conductance) @ difference).tocsr()
    first, last = arc <= ends[0] + TERMINAL_REACH_MM, arc >= ends[1] - TERMINAL_REACH_MM
    free = np.flatnonzero(~first & ~last)
    potential = first.astype(float)
    if len(free):
        right = -(matrix @ potential)[free]
        inner = matrix[free][:, free].tocsc()
        potential[free] = splu(inner, permc_spec="MMD_AT_PLUS_A").solve(right)
    current = matrix @ potential
    total = float(current[first].sum())
    if not total > 0:
        return np.inf
    covered = (current[last] @ arc[last] + current[first] @ arc[first]) / -total
    scale = (ends[1] - ends[0]) / covered if covered > TERMINAL_REACH_MM else 1.0
    return float(scale / total)


def find_necks(
    cells: Cells, contacts: Contacts, arc: Float, ends: tuple[float, float], window: float
) -> list[Neck]:
    """Return the narrowest cross-section in each of overlapping stretches along a trace.

    The cross-section is the minimum cut of the contacts' areas between the ends of a stretch.

    Args:
        cells: Cells of one trace.
        contacts: Their contacts.
        arc: Positions (n,) of the cells along the center line, mm.
        ends: First and last position, mm.
        window: Length of a stretch, mm; half of it is shared with the next.
    """
    low, high = ends
    window = min(window, high - low)
    count = max(1, int(np.ceil((high - low - window) / (window / 2))) + 1)
    starts = np.linspace(low, high - window, count)
    order = np.argsort(arc[contacts.pair].min(axis=1))
    pair, area = contacts.pair[order], _align_areas(cells, contacts)[order]
    pair, area = pair[area > 0], area[area > 0]
    first_arc = arc[pair].min(axis=1)
    last_arc = arc[pair].max(axis=1)
    necks = []
    for start in starts:
        a, b = np.searchsorted(first_arc, [start - CELL_LENGTH_MM, start + window])
        kept = a + np.flatnonzero(last_arc[a:b] <= start + window + CELL_LENGTH_MM)
        necks.append(_cut(cells, pair[kept], area[kept], arc, (start, start + window)))
    return necks


def _align_areas(cells: Cells, contacts: Contacts) -> Float:
    """Return areas (m,) of contact that a cut across parallel beads can avoid, mm^2.

    Cells of neighboring beads are staggered. A contact that is shared by two cells goes whole to
    the nearer one: otherwise a straight cut would also count areas between the beads.
    """
    i, j = contacts.pair.T
    parallel = np.abs((cells.direction[i] * cells.direction[j]).sum(axis=1)) > _PARALLEL_COSINE
    apart = contacts.distance > 0.5 * np.minimum(cells.width[i], cells.width[j])
    is_side = (contacts.kind == LAYERS) | ((contacts.kind == ACROSS) & apart)
    offset = np.abs(contacts.at).min(axis=1)
    whole = np.where(offset <= 0.5, contacts.area / (1 - np.minimum(offset, 0.5)), 0.0)
    return np.where(parallel & is_side, whole, contacts.area)


def _cut(cells: Cells, pair: Int, area: Float, arc: Float, ends: tuple[float, float]) -> Neck:
    """Return the minimum cut between the two ends of a stretch."""
    used, local = np.unique(pair, return_inverse=True)
    local = local.reshape(-1, 2)
    n, slab = len(used), 1.5 * CELL_LENGTH_MM
    middle = (ends[0] + ends[1]) / 2
    first = np.flatnonzero(arc[used] <= min(ends[0] + slab, middle))
    last = np.flatnonzero(arc[used] > max(ends[1] - slab, middle))
    nearest = cells.center[np.abs(arc - middle).argmin()]
    if not len(first) or not len(last):
        return Neck(0.0, nearest)
    capacity = np.maximum(np.round(area / AREA_UNIT_MM2), 1).astype(np.int32)
    rows = np.concatenate([local[:, 0], local[:, 1], np.full(len(first), n), last])
    columns = np.concatenate([local[:, 1], local[:, 0], first, np.full(len(last), n + 1)])
    limits = np.full(len(first) + len(last), _UNLIMITED, np.int32)
    graph = sparse.coo_array(
        (np.concatenate([capacity, capacity, limits]), (rows, columns)), shape=(n + 2, n + 2)
    ).tocsr()
    graph = sparse.csr_matrix(graph).astype(np.int32)
    flow = csgraph.maximum_flow(graph, n, n + 1)
    if flow.flow_value == 0:
        return Neck(0.0, nearest)
    residual = graph - flow.flow
    residual.data[residual.data < 0] = 0
    residual.eliminate_zeros()
    reached = np.zeros(n + 2, bool)
    reached[csgraph.breadth_first_order(residual, n, return_predecessors=False)] = True
    crossing = used[local[reached[local[:, 0]] != reached[local[:, 1]]]]
    point = cells.center[crossing].mean(axis=(0, 1))
    return Neck(float(flow.flow_value) * AREA_UNIT_MM2, point)
