"""Cords carried along by the simulated fields: signals, and what they gain as the cords move.

The fused loops behind the objective and the candidates: points are found in their tets and moved by
every state at once, and the derivatives by their rest positions are gathered without ever forming
the deformation gradients. `sensing/signal.py` defines the signal.

How the loops are written makes them several times faster. States lie innermost. A loop over them
writes to one array only, or it is not vectorised for fear that arrays overlap. Functions take whole
paths, for handing over an array costs as much as a point does.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.compiled import compiled
from ...mechanics.elements.point_location import PointLocator, walk
from ...mechanics.elements.tet10 import EDGES
from ...mechanics.elements.threads import cores, over_chunks
from ...sensing.response import Response, respond

_CHUNK = 50  # paths; fewer are not worth a thread
_NOTHING = 1e-300  # points that coincide pull nowhere
#: For each corner of a tet: the nodes on its three edges, and the corners at their other ends.
_SPOKES = [[(4 + e, a + b - i) for e, (a, b) in enumerate(EDGES) if i in (a, b)] for i in range(4)]
_ON_EDGES, _BEYOND = (np.array([[s[k] for s in spokes] for spokes in _SPOKES]) for k in (0, 1))


class CordCarrier:
    """Fields (s, n, 3) mm on the locator's mesh, kept for speed as the nodes' positions (n, 3 s) in
    all states: tet10 shape functions carry linear fields exactly, the rest positions among them."""

    def __init__(self, locator: PointLocator, fields: Float, response: Response) -> None:
        self.states = len(fields)
        #: Of a line through the origin the slope, and the total length is all that counts; of any
        #: other response 1, and lengths are those of segments stretched by w in place of eps.
        slope = response.slope_everywhere
        self.gauge_factor = 1.0 if slope is None else slope
        self.answer = (slope is None, response.breaks, response.origins, response.pieces)
        self.cells, self.by_bary = locator.mesh.cells, locator.mesh.bary_gradient
        self._where = (locator.grid, locator.across)
        placed = (locator.mesh.nodes + fields).transpose(1, 2, 0)
        self.nodal = np.ascontiguousarray(placed).reshape(len(placed), -1)

    def signals(self, paths: Float) -> Float:
        """(s, c) of polylines (c, p, 3) mm."""
        paths = np.ascontiguousarray(paths, float)
        out = np.empty((len(paths), self.states))

        def work(a: int, b: int) -> None:
            found = (self.gauge_factor, self.answer, out[a:b])
            _signals(paths[a:b], *self._where, self.cells, self.nodal, *found)

        over_chunks(work, len(paths), cores(), _CHUNK)
        return np.ascontiguousarray(out.T)

    def move(self, points: Float) -> Float:
        """Deformed positions (s, p, 3) of points (p, 3) mm."""
        points = np.ascontiguousarray(points, float)
        out = np.empty((len(points), 3 * self.states))

        def work(a: int, b: int) -> None:
            cell, bary = np.empty(b - a, np.int64), np.empty((b - a, 4))
            walk(points[a:b], *self._where, cell, bary)
            _move(cell, bary, self.cells, self.nodal, out[a:b])

        over_chunks(work, len(points), cores(), 40 * _CHUNK)
        return np.ascontiguousarray(out.reshape(len(points), 3, -1).transpose(2, 0, 1))

    def carry(self, points: Float, ends: Int) -> Carried:
        """Polylines laid end to end, points (p, 3) mm, line i being points `ends[i]` to
        `ends[i + 1]`, moved by all states."""
        cell, bary = np.empty(len(points), np.int64), np.empty((len(points), 4))
        moved = np.empty((len(points), 3 * self.states))
        steps = np.empty((len(points), self.states))
        lengths = np.empty((len(ends) - 1, self.states + 1))
        bent = np.empty((2, len(points) if self.answer[0] else 0, self.states))
        found = (cell, bary, moved, steps, lengths, bent)
        _carry(points, ends, *self._where, self.cells, self.nodal, self.answer, *found)
        return Carried(self, points, ends, found)


class Carried:
    """Polylines in all states, their `signals` (s, m), and how these depend on the points. What was
    `found` on the way: the points' tets and weights there, their moved positions, the lengths of
    segments, the lengths of lines and the derivatives of segments, see `_carry`."""

    def __init__(
        self, carrier: CordCarrier, points: Float, ends: Int, found: tuple[Any, ...]
    ) -> None:
        self._carrier, self._points, self._ends, self._found = carrier, points, ends, found
        lengths = found[-2]
        self.signals = carrier.gauge_factor * (lengths[:, :-1] / lengths[:, -1:] - 1).T

    def slopes(self) -> Float:
        """Derivatives (p, 3, s) of each line's signals by its points."""
        c = self._carrier
        out = np.empty((len(self._points), 3, c.states))
        _slopes(
            self._points, self._ends, c.cells, c.by_bary, c.nodal, c.gauge_factor, *self._found, out
        )
        return out

    def pull(self, by_signals: Float) -> Float:
        """Derivatives (p, 3) by the points of a value with derivatives (s, m) by the signals."""
        c = self._carrier
        out = np.empty_like(self._points)
        _pull(
            self._points, self._ends, c.cells, c.by_bary, c.nodal, c.gauge_factor * by_signals,
            *self._found, out,
        )  # fmt: skip
        return out


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def _move(cell, bary, cells, nodal, out):  # type: ignore[no-untyped-def]
    """Deformed positions (p, 3 s) of points in the tets `cell` (p,). All ten terms at once: half
    the time of adding row by row."""
    for p in range(len(cell)):
        e = cell[p]
        n0, n1, n2, n3, n4 = cells[e, 0], cells[e, 1], cells[e, 2], cells[e, 3], cells[e, 4]
        n5, n6, n7, n8, n9 = cells[e, 5], cells[e, 6], cells[e, 7], cells[e, 8], cells[e, 9]
        a, b, c, d = bary[p, 0], bary[p, 1], bary[p, 2], bary[p, 3]
        # The ten shape functions, as in `tet10.shape`.
        w0, w1, w2, w3 = a * (2 * a - 1), b * (2 * b - 1), c * (2 * c - 1), d * (2 * d - 1)
        w4, w5, w6, w7, w8, w9 = 4 * a * b, 4 * b * c, 4 * a * c, 4 * a * d, 4 * b * d, 4 * c * d
        for k in range(nodal.shape[1]):
            out[p, k] = (
                w0 * nodal[n0, k] + w1 * nodal[n1, k] + w2 * nodal[n2, k] + w3 * nodal[n3, k]
                + w4 * nodal[n4, k] + w5 * nodal[n5, k] + w6 * nodal[n6, k] + w7 * nodal[n7, k]
                + w8 * nodal[n8, k] + w9 * nodal[n9, k]
            )  # fmt: skip


@compiled(inline="always")
def _apart(points, p):  # type: ignore[no-untyped-def]
    """How far point p lies from the one before."""
    x, y = points[p, 0] - points[p - 1, 0], points[p, 1] - points[p - 1, 1]
    z = points[p, 2] - points[p - 1, 2]
    return np.sqrt(x * x + y * y + z * z) + _NOTHING


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def _measure(points, moved, first, last, steps, lengths):  # type: ignore[no-untyped-def]
    """Of the line of points first to last: deformed lengths (p, s) of the segments that end at each
    point, and their sums (s + 1,), the rest length last."""
    states = steps.shape[1]
    lengths[:] = 0.0
    for p in range(first + 1, last):
        lengths[states] += _apart(points, p)
        for s in range(states):
            x = moved[p, s] - moved[p - 1, s]
            y = moved[p, states + s] - moved[p - 1, states + s]
            z = moved[p, 2 * states + s] - moved[p - 1, 2 * states + s]
            steps[p, s] = np.sqrt(x * x + y * y + z * z) + _NOTHING
        for s in range(states):
            lengths[s] += steps[p, s]


@compiled(error_model="numpy")
def _answer(points, first, last, steps, answer, lengths, bent):  # type: ignore[no-untyped-def]
    """After `_measure`, for a response that is not a line: the sums of what each segment's length
    would be if it were stretched by w in place of eps, L (1 + w), and into `bent` (2, p, s), unless
    it is empty, the derivatives of that by the deformed length and by the rest length L."""
    _, breaks, origins, pieces = answer
    states = steps.shape[1]
    for s in range(states):
        lengths[s] = 0.0
    for p in range(first + 1, last):
        rest = _apart(points, p)
        for s in range(states):
            stretch = steps[p, s] / rest
            w, slope = respond(stretch - 1, breaks, origins, pieces)
            lengths[s] += rest * (1 + w)
            if bent.size:
                bent[0, p, s] = slope
                bent[1, p, s] = 1 + w - stretch * slope


@compiled(error_model="numpy")
def _signals(  # type: ignore[no-untyped-def]
    paths, grid, across, cells, nodal, gauge_factor, answer, out
):
    count, states = paths.shape[1], out.shape[1]
    cell, bary = np.empty(count, np.int64), np.empty((count, 4))
    moved, steps = np.empty((count, 3 * states)), np.empty((count, states))
    lengths, unused = np.empty(states + 1), np.empty((2, 0, states))
    for c in range(len(paths)):
        walk(paths[c], grid, across, cell, bary)
        _move(cell, bary, cells, nodal, moved)
        _measure(paths[c], moved, 0, count, steps, lengths)
        if answer[0]:
            _answer(paths[c], 0, count, steps, answer, lengths, unused)
        for s in range(states):
            out[c, s] = gauge_factor * (lengths[s] / lengths[states] - 1)


@compiled(error_model="numpy")
def _carry(  # type: ignore[no-untyped-def]
    points, ends, grid, across, cells, nodal, answer, cell, bary, moved, steps, lengths, bent
):
    walk(points, grid, across, cell, bary)
    _move(cell, bary, cells, nodal, moved)
    for c in range(len(ends) - 1):
        _measure(points, moved, ends[c], ends[c + 1], steps, lengths[c])
        if answer[0]:
            _answer(points, ends[c], ends[c + 1], steps, answer, lengths[c], bent)


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def _pulls(ends, moved, steps, weights, bent, out):  # type: ignore[no-untyped-def]
    """Unit vectors (p + 1, 3 s) of the segments that end at each point times their line's weights
    (m, s) and their own derivatives `bent[0]`, if any; zero where a line begins and at the very
    end."""
    states = steps.shape[1]
    out[ends[-1]] = 0.0
    for c in range(len(ends) - 1):
        out[ends[c]] = 0.0
        for p in range(ends[c] + 1, ends[c + 1]):
            for a in range(0, 3 * states, states):
                for s in range(states):
                    step = moved[p, a + s] - moved[p - 1, a + s]
                    out[p, a + s] = weights[c, s] / steps[p, s] * step
                if bent.size:
                    for s in range(states):
                        out[p, a + s] *= bent[0, p, s]


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def _slopes(  # type: ignore[no-untyped-def]
    points, ends, cells, by_bary, nodal, gauge_factor, cell, bary, moved, steps, lengths, bent, out
):
    states = steps.shape[1]
    one, two = states, 2 * states
    weights = np.empty((len(ends) - 1, states))
    for c in range(len(weights)):
        weights[c] = gauge_factor / lengths[c, states]
    pulls = np.empty((len(points) + 1, 3 * states))
    _pulls(ends, moved, steps, weights, bent, pulls)
    v = np.empty(3 * states)  # derivative of the signals by the deformed point
    by_corner = np.empty((4, states))
    for p in range(len(points)):
        e = cell[p]
        for k in range(3 * states):
            v[k] = pulls[p, k] - pulls[p + 1, k]
        for i in range(4):
            n0, w0 = cells[e, i], 4 * bary[p, i] - 1
            n1, w1 = cells[e, _ON_EDGES[i, 0]], 4 * bary[p, _BEYOND[i, 0]]
            n2, w2 = cells[e, _ON_EDGES[i, 1]], 4 * bary[p, _BEYOND[i, 1]]
            n3, w3 = cells[e, _ON_EDGES[i, 2]], 4 * bary[p, _BEYOND[i, 2]]
            for s in range(states):
                x = w0 * nodal[n0, s] + w1 * nodal[n1, s] + w2 * nodal[n2, s] + w3 * nodal[n3, s]
                t = one + s
                y = w0 * nodal[n0, t] + w1 * nodal[n1, t] + w2 * nodal[n2, t] + w3 * nodal[n3, t]
                u = two + s
                z = w0 * nodal[n0, u] + w1 * nodal[n1, u] + w2 * nodal[n2, u] + w3 * nodal[n3, u]
                by_corner[i, s] = v[s] * x + v[t] * y + v[u] * z
        for a in range(3):
            g0, g1, g2, g3 = by_bary[e, 0, a], by_bary[e, 1, a], by_bary[e, 2, a], by_bary[e, 3, a]
            for s in range(states):
                out[p, a, s] = (
                    g0 * by_corner[0, s] + g1 * by_corner[1, s]
                    + g2 * by_corner[2, s] + g3 * by_corner[3, s]
                )  # fmt: skip
    for c in range(len(ends) - 1):
        rest = gauge_factor / lengths[c, states] ** 2
        for p in range(ends[c] + 1, ends[c + 1]):
            inverse = rest / _apart(points, p)
            for a in range(3):
                step = inverse * (points[p, a] - points[p - 1, a])
                for s in range(states):
                    out[p, a, s] -= step * lengths[c, s]
                for s in range(states):
                    out[p - 1, a, s] += step * lengths[c, s]
                if bent.size:
                    for s in range(states):
                        out[p, a, s] += step * lengths[c, states] * bent[1, p, s]
                    for s in range(states):
                        out[p - 1, a, s] -= step * lengths[c, states] * bent[1, p, s]


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def _pull(  # type: ignore[no-untyped-def]
    points, ends, cells, by_bary, nodal, by_signals, cell, bary, moved, steps, lengths, bent, out
):
    """`_slopes` times `by_signals` (s, m), which include the gauge factor."""
    states = steps.shape[1]
    weights = np.empty((len(ends) - 1, states))
    for c in range(len(weights)):
        for s in range(states):
            weights[c, s] = by_signals[s, c] / lengths[c, states]
    pulls = np.empty((len(points) + 1, 3 * states))
    _pulls(ends, moved, steps, weights, bent, pulls)
    by_node = np.empty(10)
    for p in range(len(points)):
        e = cell[p]
        n0, n1, n2, n3, n4 = cells[e, 0], cells[e, 1], cells[e, 2], cells[e, 3], cells[e, 4]
        n5, n6, n7, n8, n9 = cells[e, 5], cells[e, 6], cells[e, 7], cells[e, 8], cells[e, 9]
        h0 = h1 = h2 = h3 = h4 = h5 = h6 = h7 = h8 = h9 = 0.0
        for k in range(3 * states):
            v = pulls[p, k] - pulls[p + 1, k]
            h0 += v * nodal[n0, k]
            h1 += v * nodal[n1, k]
            h2 += v * nodal[n2, k]
            h3 += v * nodal[n3, k]
            h4 += v * nodal[n4, k]
            h5 += v * nodal[n5, k]
            h6 += v * nodal[n6, k]
            h7 += v * nodal[n7, k]
            h8 += v * nodal[n8, k]
            h9 += v * nodal[n9, k]
        by_node[0], by_node[1], by_node[2], by_node[3], by_node[4] = h0, h1, h2, h3, h4
        by_node[5], by_node[6], by_node[7], by_node[8], by_node[9] = h5, h6, h7, h8, h9
        for a in range(3):
            out[p, a] = 0.0
        for i in range(4):
            h = (4 * bary[p, i] - 1) * by_node[i]
            for j in range(3):
                h += 4 * bary[p, _BEYOND[i, j]] * by_node[_ON_EDGES[i, j]]
            for a in range(3):
                out[p, a] += h * by_bary[e, i, a]
    for c in range(len(ends) - 1):
        rest = 0.0
        for s in range(states):
            rest += weights[c, s] * lengths[c, s] / lengths[c, states]
        for p in range(ends[c] + 1, ends[c + 1]):
            own = rest
            if bent.size:
                for s in range(states):
                    own -= weights[c, s] * bent[1, p, s]
            inverse = own / _apart(points, p)
            for a in range(3):
                step = inverse * (points[p, a] - points[p - 1, a])
                out[p, a] -= step
                out[p - 1, a] += step
