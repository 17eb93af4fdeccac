"""Route planar paths of straight runs and turns of one radius, and search for a short one."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from ...core.arrays import Bool, Float

#: Number of directions of a route in a full turn, counted from its first.
HEADINGS = 24
MAX_STATES = 60_000  # visited before a search gives up
TURN_COST = 0.5  # extra cost of a turn, as a share of its length
CHANGE_COST_MM = 0.5  # cost of a change between turn and run


@dataclass(frozen=True)
class PlanarRoute:
    """A path of moves of equal length.

    Attributes:
        start: Start (2,), mm.
        heading: Direction at the start, rad.
        radius: Radius of turns, mm.
        moves: Moves: ahead (0), or along a circle to the left (1) or right (-1).
    """

    start: Float
    heading: float
    radius: float
    moves: tuple[int, ...]

    @property
    def step(self) -> float:
        """Length of a move, mm."""
        return move_length(self.radius)

    @property
    def length(self) -> float:
        """Length of the route, mm."""
        return len(self.moves) * self.step

    @property
    def arcs(self) -> Float:
        """The runs and turns (n, 3, 2), each by start, middle and end, mm."""
        out, p, angle = [], self.start, self.heading
        for turn, count in _group_runs(self.moves):
            middle, _ = _advance(p, angle, turn, count / 2, self.radius)
            end, angle = _advance(p, angle, turn, count, self.radius)
            out.append(np.stack([p, middle, end]))
            p = end
        return np.stack(out)

    @property
    def end_heading(self) -> float:
        """Direction at the end, rad."""
        return self.heading + sum(self.moves) * 2 * np.pi / HEADINGS

    @property
    def directions(self) -> Float:
        """Unit directions (2, 2) at the start and at the end."""
        angle = np.array([self.heading, self.end_heading])
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def sample(self, spacing: float) -> Float:
        """Return points (n, 2) along the route, at most `spacing` mm apart."""
        return self._points(int(np.ceil(self.step / spacing)), sparse=False)

    @property
    def polyline(self) -> Float:
        """The fewest points (n, 2), mm: runs by their ends, turns every five degrees."""
        return self._points(3, sparse=True)

    def _points(self, per: int, sparse: bool) -> Float:
        """Return `per` points a move; if sparse, a run has none between its ends."""
        points, p, angle = [self.start], self.start, self.heading
        for turn, count in _group_runs(self.moves):
            n = 1 if sparse and turn == 0 else count * per
            points += [
                _advance(p, angle, turn, count * k / n, self.radius)[0] for k in range(1, n + 1)
            ]
            p, angle = points[-1], angle + turn * count * 2 * np.pi / HEADINGS
        return np.array(points)


@dataclass(frozen=True)
class Grid:
    """Cells of a plane.

    Attributes:
        low: Center (2,) of the first cell, mm.
        cell: Size of a cell, mm.
        room: Room (nx, ny) for a route's center beyond what it needs, mm.
        goal: Whether cells (nx, ny) are the goal.
    """

    low: Float
    cell: float
    room: Float
    goal: Bool

    def cell_of(self, x: float, y: float) -> tuple[int, int] | None:
        """Return the cell of a point; None if it is outside."""
        i = int((x - self.low[0]) / self.cell + 0.5)
        j = int((y - self.low[1]) / self.cell + 0.5)
        return (i, j) if 0 <= i < self.room.shape[0] and 0 <= j < self.room.shape[1] else None

    @property
    def free(self) -> Bool:
        """Where a route may go: the center of a point's cell is up to 0.71 cells away from it."""
        return np.asarray((self.room > 0.71 * self.cell) | self.goal)


def move_length(radius: float) -> float:
    """Return the length of the arc between two headings, mm."""
    return radius * 2 * np.pi / HEADINGS


def find_route(starts: Sequence[PlanarRoute], grid: Grid) -> PlanarRoute | None:
    """Return the cheapest route to the goal, or None.

    A* over position and direction, guided by the distances of a search that may turn on the spot.

    Args:
        starts: First moves to continue from, all from one place in one direction.
        grid: Cells with their room and the goal.

    References:
        Dolgov et al. (2010), Path planning for autonomous vehicles in unknown environments.
    """
    if not starts:
        return None
    free = grid.free
    distances = _distances(free, grid)
    first = starts[0]
    length = first.step
    moves_of = _move_table(first)
    queue: list[tuple[float, int, float, float, float, int, tuple[int, ...]]] = []
    count = 0

    def push(cost: float, x: float, y: float, turns: int, moves: tuple[int, ...]) -> None:
        nonlocal count
        cell = grid.cell_of(x, y)
        if cell is not None and np.isfinite(distances[cell]):
            count += 1  # entries of one cost keep their order
            entry = (cost + float(distances[cell]), count, cost, x, y, turns % HEADINGS, moves)
            heapq.heappush(queue, entry)

    for route in starts:
        x, y = route.arcs[-1, 2].tolist()
        push(_cost(route.moves, length), x, y, sum(route.moves), route.moves)
    visited: set[tuple[int, int, int, int]] = set()
    while queue and len(visited) < MAX_STATES:
        _, _, cost, x, y, turns, moves = heapq.heappop(queue)
        cell = grid.cell_of(x, y)
        if cell is None or grid.goal[cell]:
            return PlanarRoute(first.start, first.heading, first.radius, moves)
        state = (int(2 * x // length), int(2 * y // length), turns, moves[-1])
        if state in visited:
            continue
        visited.add(state)
        for turn in (0, 1, -1):
            (mx, my), (ex, ey) = moves_of[turns][turn]
            middle, end = grid.cell_of(x + mx, y + my), grid.cell_of(x + ex, y + ey)
            if middle and end and free[middle] and free[end]:
                added_cost = length * (1 + TURN_COST * abs(turn)) + CHANGE_COST_MM * (
                    turn != moves[-1]
                )
                push(cost + added_cost, x + ex, y + ey, turns + turn, (*moves, turn))
    return None


def _move_table(
    route: PlanarRoute,
) -> list[dict[int, tuple[tuple[float, float], tuple[float, float]]]]:
    """Return, for every direction and move, where its middle and its end are from its start, mm."""
    out = []
    for turns in range(HEADINGS):
        angle = route.heading + turns * 2 * np.pi / HEADINGS
        row = {}
        for turn in (-1, 0, 1):
            (mx, my), (ex, ey) = (
                _advance(np.zeros(2), angle, turn, share, route.radius)[0].tolist()
                for share in (0.5, 1.0)
            )
            row[turn] = ((mx, my), (ex, ey))
        out.append(row)
    return out


def _advance(p: Float, angle: float, turn: int, moves: float, radius: float) -> tuple[Float, float]:
    """Return position and direction after a number of equal moves."""
    if turn == 0:
        return p + moves * move_length(radius) * np.array([np.cos(angle), np.sin(angle)]), angle
    after = angle + turn * moves * 2 * np.pi / HEADINGS
    side = turn * radius * np.array([-np.sin(angle), np.cos(angle)])
    back = turn * radius * np.array([-np.sin(after), np.cos(after)])
    return p + side - back, after


def _group_runs(moves: Sequence[int]) -> list[tuple[int, int]]:
    """Return runs of equal moves, as move and count; a turn of half a circle or more in two."""
    out: list[tuple[int, int]] = []
    for m in moves:
        if out and out[-1][0] == m and (m == 0 or out[-1][1] < HEADINGS // 2 - 1):
            out[-1] = (m, out[-1][1] + 1)
        else:
            out.append((m, 1))
    return out


def _cost(moves: Sequence[int], length: float) -> float:
    bending = sum(abs(m) for m in moves)
    return length * (len(moves) + TURN_COST * bending)


def _distances(free: Bool, grid: Grid) -> Float:
    """Return the distance of each cell from the goal through free cells, mm; infinite if cut
    off.
    """
    nx, ny = free.shape
    number = np.arange(free.size).reshape(nx, ny)
    pairs, lengths = [], []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        a = number[: nx - dx, max(0, -dy) : ny - max(0, dy)].ravel()
        b = number[dx:, max(0, dy) : ny - max(0, -dy)].ravel()
        both = free.ravel()[a] & free.ravel()[b]
        pairs.append(np.stack([a[both], b[both]]))
        lengths.append(np.full(int(both.sum()), np.hypot(dx, dy) * grid.cell))
    if not (goals := number[grid.goal]).size:
        return np.full(free.shape, np.inf)
    edges = (np.concatenate(lengths), tuple(np.concatenate(pairs, axis=1)))
    graph = coo_matrix(edges, (free.size, free.size)).tocsr()
    distances = dijkstra(graph, directed=False, indices=goals, min_only=True)
    return np.asarray(distances).reshape(free.shape)
