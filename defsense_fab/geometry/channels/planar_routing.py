"""Planar ways of straight runs and turns of one radius, and the search for a short one."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from ...core.arrays import Bool, Float

#: Directions of a way: multiples of a full turn over this many from its first.
HEADINGS = 24
_STATES = 60_000  # looked at before a search gives up
_BENDING = 0.5  # a turn costs this much more than a straight run of its length
_CHANGING = 0.5  # mm, that a change between turn and run costs


@dataclass(frozen=True)
class Way:
    """From `start` (2,) mm in the direction `heading` (rad), `moves` of one length each: ahead
    (0), or along a circle of `radius` mm to the left (1) or right (-1)."""

    start: Float
    heading: float
    radius: float
    moves: tuple[int, ...]

    @property
    def step(self) -> float:
        """Length of a move, mm."""
        return step(self.radius)

    @property
    def length(self) -> float:
        return len(self.moves) * self.step

    @property
    def arcs(self) -> Float:
        """The runs and turns (n, 3, 2) mm, each by start, middle and end."""
        out, p, angle = [], self.start, self.heading
        for turn, count in _runs(self.moves):
            middle, _ = _go(p, angle, turn, count / 2, self.radius)
            end, angle = _go(p, angle, turn, count, self.radius)
            out.append(np.stack([p, middle, end]))
            p = end
        return np.stack(out)

    @property
    def end_heading(self) -> float:
        return self.heading + sum(self.moves) * 2 * np.pi / HEADINGS

    @property
    def directions(self) -> Float:
        """Unit directions (2, 2) at the start and at the end."""
        angle = np.array([self.heading, self.end_heading])
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def sample(self, spacing: float) -> Float:
        """Points (n, 2) mm along the way, at most `spacing` mm apart."""
        return self._points(int(np.ceil(self.step / spacing)), sparse=False)

    @property
    def polyline(self) -> Float:
        """The fewest points (n, 2) mm: runs by their ends, turns every five degrees."""
        return self._points(3, sparse=True)

    def _points(self, per: int, sparse: bool) -> Float:
        """So many points a move; if sparse, a run has none between its ends."""
        points, p, angle = [self.start], self.start, self.heading
        for turn, count in _runs(self.moves):
            n = 1 if sparse and turn == 0 else count * per
            points += [_go(p, angle, turn, count * k / n, self.radius)[0] for k in range(1, n + 1)]
            p, angle = points[-1], angle + turn * count * 2 * np.pi / HEADINGS
        return np.array(points)


@dataclass(frozen=True)
class Grid:
    """Cells of `cell` mm from `low` (2,) mm on: the `room` (nx, ny) that a way's centre has there
    beyond what it needs, mm, and whether they are the `goal`."""

    low: Float
    cell: float
    room: Float
    goal: Bool

    def cell_of(self, x: float, y: float) -> tuple[int, int] | None:
        """The cell of a point; None where it lies outside."""
        i = int((x - self.low[0]) / self.cell + 0.5)
        j = int((y - self.low[1]) / self.cell + 0.5)
        return (i, j) if 0 <= i < self.room.shape[0] and 0 <= j < self.room.shape[1] else None

    @property
    def free(self) -> Bool:
        """Where a way may go: the middle of a point's cell is up to 0.71 cells away from it."""
        return np.asarray((self.room > 0.71 * self.cell) | self.goal)


def step(radius: float) -> float:
    """Length of the arc between two headings, mm."""
    return radius * 2 * np.pi / HEADINGS


def search(begun: Sequence[Way], grid: Grid) -> Way | None:
    """The cheapest way that goes on from one of those `begun`, all from one place in one direction,
    to a cell of the goal through cells that have room; None where none is found.

    A* over place and direction, led by the distances of a search that may turn on the spot
    (Dolgov et al. 2010).
    """
    if not begun:
        return None
    free = grid.free
    ahead = _distances(free, grid)
    first = begun[0]
    length = first.step
    moves_of = _table(first)
    queue: list[tuple[float, int, float, float, float, int, tuple[int, ...]]] = []
    count = 0

    def push(cost: float, x: float, y: float, turns: int, moves: tuple[int, ...]) -> None:
        nonlocal count
        cell = grid.cell_of(x, y)
        if cell is not None and np.isfinite(ahead[cell]):
            count += 1  # entries of one cost keep their order
            entry = (cost + float(ahead[cell]), count, cost, x, y, turns % HEADINGS, moves)
            heapq.heappush(queue, entry)

    for way in begun:
        x, y = way.arcs[-1, 2].tolist()
        push(_cost(way.moves, length), x, y, sum(way.moves), way.moves)
    seen: set[tuple[int, int, int, int]] = set()
    while queue and len(seen) < _STATES:
        _, _, cost, x, y, turns, moves = heapq.heappop(queue)
        cell = grid.cell_of(x, y)
        if cell is None or grid.goal[cell]:
            return Way(first.start, first.heading, first.radius, moves)
        state = (int(2 * x // length), int(2 * y // length), turns, moves[-1])
        if state in seen:
            continue
        seen.add(state)
        for turn in (0, 1, -1):
            (mx, my), (ex, ey) = moves_of[turns][turn]
            middle, end = grid.cell_of(x + mx, y + my), grid.cell_of(x + ex, y + ey)
            if middle and end and free[middle] and free[end]:
                more = length * (1 + _BENDING * abs(turn)) + _CHANGING * (turn != moves[-1])
                push(cost + more, x + ex, y + ey, turns + turn, (*moves, turn))
    return None


def _table(way: Way) -> list[dict[int, tuple[tuple[float, float], tuple[float, float]]]]:
    """For every direction and move: where its middle and its end lie from its start, mm."""
    out = []
    for turns in range(HEADINGS):
        angle = way.heading + turns * 2 * np.pi / HEADINGS
        row = {}
        for turn in (-1, 0, 1):
            (mx, my), (ex, ey) = (
                _go(np.zeros(2), angle, turn, part, way.radius)[0].tolist() for part in (0.5, 1.0)
            )
            row[turn] = ((mx, my), (ex, ey))
        out.append(row)
    return out


def _go(p: Float, angle: float, turn: int, moves: float, radius: float) -> tuple[Float, float]:
    """Place and direction after a number of equal moves."""
    if turn == 0:
        return p + moves * step(radius) * np.array([np.cos(angle), np.sin(angle)]), angle
    after = angle + turn * moves * 2 * np.pi / HEADINGS
    side = turn * radius * np.array([-np.sin(angle), np.cos(angle)])
    back = turn * radius * np.array([-np.sin(after), np.cos(after)])
    return p + side - back, after


def _runs(moves: Sequence[int]) -> list[tuple[int, int]]:
    """Equal moves in a row, as move and count; a turn of half a circle or more in two."""
    out: list[tuple[int, int]] = []
    for m in moves:
        if out and out[-1][0] == m and (m == 0 or out[-1][1] < HEADINGS // 2 - 1):
            out[-1] = (m, out[-1][1] + 1)
        else:
            out.append((m, 1))
    return out


def _cost(moves: Sequence[int], length: float) -> float:
    bending = sum(abs(m) for m in moves)
    return length * (len(moves) + _BENDING * bending)


def _distances(free: Bool, grid: Grid) -> Float:
    """How far each cell is from the goal through free cells, mm; infinite where cut off."""
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
    found = dijkstra(graph, directed=False, indices=goals, min_only=True)
    return np.asarray(found).reshape(free.shape)
