"""Compute the signals of cords that the simulated fields move, and their derivatives.

These are the fused loops behind the objective and the candidates. Points are located in their tets
and moved by all states at once, and the derivatives by their rest positions are gathered without
forming deformation gradients. `sensing/response.py` defines the signal.

The loops are written for speed, by a factor of several. States are the innermost index. A loop over
states writes to one array only; otherwise the compiler assumes that arrays may overlap and does not
vectorize it. Functions take whole paths, because passing an array costs as much as a point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row
from ...mechanics.elements.point_location import PointLocator, locate_along_path
from ...mechanics.elements.tet10 import EDGES
from ...mechanics.elements.threads import count_cores, run_in_chunks
from ...sensing.response import Response, evaluate_response

_CHUNK_PATHS = 50  # fewer are not worth a thread
_MIN_LENGTH_MM = 1e-300  # added to lengths, so that coincident points have zero derivatives
#: For each corner of a tet, the nodes on its three edges and the corners at their other ends.
_SPOKES = [[(4 + e, a + b - i) for e, (a, b) in enumerate(EDGES) if i in (a, b)] for i in range(4)]
_ON_EDGES, _BEYOND = (np.array([[s[k] for s in spokes] for spokes in _SPOKES]) for k in (0, 1))


@dataclass(frozen=True)
class SignalModel:
    """How a cord senses: the signal L w / sqrt((L + series)^2 + contact^2).

    L is the rest length of the strained middle part of the path, and w its relative resistance
    change. The division gives all signals the same noise, that of a very long cord (see
    `sensing/built_cord.py`).

    Attributes:
        response: Response w of the cord to strain.
        local: Whether w is the mean of the responses to the segments' strains, rather than the
            response to the mean strain.
        hidden: Length at each end that is not strained because it lies in a pocket, mm.
        series: Length of cord that conducts but is not strained, mm.
        contact: Length of a cord whose noise of (R - R0)/R0 equals the noise that the joints add,
            mm.
    """

    response: Response
    local: bool = False
    hidden: float = 0.0
    series: float = 0.0
    contact: float = 0.0


class CordCarrier:
    """Moves points and cords by all fields at once.

    The nodes' deformed positions (n, 3 s) are interpolated. This is exact, because quadratic shape
    functions reproduce linear fields such as the rest positions.

    Args:
        locator: Locator of the mesh.
        fields: Displacements (s, n, 3) mm of its nodes in s states.
        model: How cords sense.

    Attributes:
        states: Number of states.
        bent: Whether the strained length has derivatives other than 0 and 1 by its segments.
        answer: The signal model as the compiled loops take it.
        cells: (m, 10) nodes of the tets.
        by_bary: (m, 4, 3) gradients of the barycentric coordinates.
        nodal: (n, 3 s) mm, deformed positions of the nodes.
    """

    def __init__(self, locator: PointLocator, fields: Float, model: SignalModel) -> None:
        self.states = len(fields)
        response = model.response
        is_linear = response.linear_slope is not None  # only the mean strain then matters
        self._local = model.local and not is_linear
        self.bent = self._local or model.hidden > 0
        table = (response.breaks, response.origins, response.pieces)
        self.answer = (self._local, model.hidden, model.series, model.contact**2, *table)
        self.cells, self.by_bary = locator.mesh.cells, locator.mesh.bary_gradient
        self._where = (locator.grid, locator.opposite_tets)
        placed = (locator.mesh.nodes + fields).transpose(1, 2, 0)
        self.nodal = np.ascontiguousarray(placed).reshape(len(placed), -1)

    def signals(self, paths: Float) -> Float:
        """Return the signals (s, c) of polylines (c, p, 3) mm."""
        paths = np.ascontiguousarray(paths, float)
        out = np.empty((len(paths), self.states))

        def work(a: int, b: int) -> None:
            _signals(paths[a:b], *self._where, self.cells, self.nodal, self.answer, out[a:b])

        run_in_chunks(work, len(paths), count_cores(), _CHUNK_PATHS)
        return np.ascontiguousarray(out.T)

    def move(self, points: Float) -> Float:
        """Return the deformed positions (s, p, 3) mm of points (p, 3) mm."""
        points = np.ascontiguousarray(points, float)
        out = np.empty((len(points), 3 * self.states))

        def work(a: int, b: int) -> None:
            cell, bary = np.empty(b - a, np.int64), np.empty((b - a, 4))
            locate_along_path(points[a:b], *self._where, cell, bary)
            _move(cell, bary, self.cells, self.nodal, out[a:b])

        run_in_chunks(work, len(points), count_cores(), 40 * _CHUNK_PATHS)
        return np.ascontiguousarray(out.reshape(len(points), 3, -1).transpose(2, 0, 1))

    def carry(self, points: Float, ends: Int) -> CarriedCords:
        """Move several polylines by all states.

        Args:
            points: Points (p, 3) mm of all lines, one line after the other.
            ends: (m + 1,) numbers; line i has the points `ends[i]` to `ends[i + 1]`.
        """
        cell, bary = np.empty(len(points), np.int64), np.empty((len(points), 4))
        moved = np.empty((len(points), 3 * self.states))
        steps = np.empty((len(points), self.states))
        signals = np.empty((len(ends) - 1, 3, self.states))
        bent = np.empty((2, len(points) if self.bent else 0, self.states))
        found = (cell, bary, moved, steps, signals, bent)
        _carry(points, ends, *self._where, self.cells, self.nodal, self.answer, *found)
        return CarriedCords(self, points, ends, found)


class CarriedCords:
    """Polylines in all states, with their signals and derivatives.

    Args:
        carrier: The carrier that moved them.
        points: Points (p, 3) mm of all lines.
        ends: (m + 1,) ranges of the lines' points.
        found: Intermediate arrays of `_carry`: tets and weights of the points, moved positions,
            lengths of segments, signals with their derivatives by strained length and rest length,
            and derivatives of strained lengths by segments.

    Attributes:
        signals: (s, m), signals of the lines.
    """

    def __init__(
        self, carrier: CordCarrier, points: Float, ends: Int, found: tuple[Any, ...]
    ) -> None:
        self._carrier, self._points, self._ends, self._found = carrier, points, ends, found
        self.signals = found[-2][:, 0].T

    def slopes(self) -> Float:
        """Return the derivatives (p, 3, s) of each line's signals by its points."""
        c = self._carrier
        out = np.empty((len(self._points), 3, c.states))
        _slopes(self._points, self._ends, c.cells, c.by_bary, c.nodal, *self._found, out)
        return out

    def pull(self, by_signals: Float) -> Float:
        """Return a value's derivatives (p, 3) by the points from those (s, m) by the signals."""
        c = self._carrier
        out = np.empty_like(self._points)
        _pull(
            self._points, self._ends, c.cells, c.by_bary, c.nodal, by_signals, *self._found, out,
        )  # fmt: skip
        return out


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def _move(cell, bary, cells, nodal, out):  # type: ignore[no-untyped-def]
    """Fill deformed positions (p, 3 s) of points in the tets `cell` (p,).

    Summing all ten terms at once takes half the time of adding row by row.
    """
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
def _segment_length(points, p):  # type: ignore[no-untyped-def]
    """Return the distance of point p from the previous point."""
    x, y = points[p, 0] - points[p - 1, 0], points[p, 1] - points[p - 1, 1]
    z = points[p, 2] - points[p - 1, 2]
    return np.sqrt(x * x + y * y + z * z) + _MIN_LENGTH_MM


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def _measure(moved, first, last, steps, shares, lengths):  # type: ignore[no-untyped-def]
    """Fill deformed segment lengths `steps` (p, s) and strained lengths `lengths` (s,) of a line.

    A segment is stored at its end point; `shares` (p,) is the strained share of each segment.
    """
    states = steps.shape[1]
    lengths[:] = 0.0
    for p in range(first + 1, last):
        for s in range(states):
            x = moved[p, s] - moved[p - 1, s]
            y = moved[p, states + s] - moved[p - 1, states + s]
            z = moved[p, 2 * states + s] - moved[p - 1, 2 * states + s]
            steps[p, s] = np.sqrt(x * x + y * y + z * z) + _MIN_LENGTH_MM
        for s in range(states):
            lengths[s] += shares[p] * steps[p, s]


@compiled(error_model="numpy")
def _strained(points, first, last, hidden, shares):  # type: ignore[no-untyped-def]
    """Fill the strained share of each segment: the part at least `hidden` mm from both line ends.

    Returns the rest length of the strained part, and the end points of the segments in which it
    starts and ends.
    """
    total = 0.0
    for p in range(first + 1, last):
        total += _segment_length(points, p)
    inside = max(total - 2 * hidden, _MIN_LENGTH_MM)
    along, begins, ends = 0.0, first, last
    for p in range(first + 1, last):
        step = _segment_length(points, p)
        low, high = max(along, hidden), min(along + step, total - hidden)
        shares[p] = max(high - low, 0.0) / step if hidden > 0 else 1.0
        if along <= hidden < along + step:
            begins = p
        if along < total - hidden <= along + step:
            ends = p
        along += step
    return inside, begins, ends


@compiled(error_model="numpy")
def _signal(  # type: ignore[no-untyped-def]
    points, moved, first, last, answer, steps, shares, lengths, out, bent
):
    """Fill `out` (3, s) with a line's signals and their derivatives by deformed and rest length.

    Both lengths are of the strained part. For a local response the deformed length is the sum of
    L (1 + w) over the segments, as if they were stretched by w instead of their strain.

    `bent` (2, p, s), unless empty, receives the derivatives of the strained length by the deformed
    and the rest lengths of the segments that end at each point.
    """
    local, hidden, series, contact_square, breaks, origins, pieces = answer
    states = steps.shape[1]
    rest, begins, ends = _strained(points, first, last, hidden, shares)
    _measure(moved, first, last, steps, shares, lengths)
    if local:
        lengths[:] = 0.0
        for p in range(first + 1, last):
            own = _segment_length(points, p)
            for s in range(states):
                stretch = steps[p, s] / own
                w, slope = evaluate_response(stretch - 1, breaks, origins, pieces)
                lengths[s] += shares[p] * own * (1 + w)
                if bent.size:
                    bent[0, p, s] = shares[p] * slope
                    bent[1, p, s] = shares[p] * (1 + w - stretch * slope)
    elif bent.size:
        for p in range(first + 1, last):
            bent[0, p] = shares[p]
            bent[1, p] = 0.0
    if bent.size and hidden > 0 and begins < ends:
        # A longer segment before the strained part moves the start of that part along its segment.
        for at, low, high in ((begins, first + 1, begins), (ends, ends + 1, last)):
            own = _segment_length(points, at)
            for s in range(states):
                dense = steps[at, s] / own
                if local:
                    dense = 1 + evaluate_response(dense - 1, breaks, origins, pieces)[0]
                for p in range(low, high):
                    bent[1, p, s] += dense
                bent[1, at, s] += dense * (1 - shares[at])
    whole = np.sqrt((rest + series) ** 2 + contact_square)
    dilution = 1 - rest * (rest + series) / whole**2
    for s in range(states):
        w, slope = lengths[s] / rest - 1, 1.0
        if not local:
            w, slope = evaluate_response(w, breaks, origins, pieces)
        out[0, s] = w * rest / whole
        out[1, s] = slope / whole
        out[2, s] = (w * dilution - slope * lengths[s] / rest) / whole


@compiled(error_model="numpy")
def _signals(paths, grid, across, cells, nodal, answer, out):  # type: ignore[no-untyped-def]
    count, states = paths.shape[1], out.shape[1]
    cell, bary = np.empty(count, np.int64), np.empty((count, 4))
    moved, steps = np.empty((count, 3 * states)), np.empty((count, states))
    lengths, shares, unused = np.empty(states), np.empty(count), np.empty((2, 0, states))
    found, first = np.empty((3, states)), np.int64(0)  # not 0: as in `point_location.walk`
    for c in range(len(paths)):
        locate_along_path(paths[c], grid, across, cell, bary)
        _move(cell, bary, cells, nodal, moved)
        _signal(paths[c], moved, first, count, answer, steps, shares, lengths, found, unused)
        copy_row(found[0], out[c])


@compiled(error_model="numpy")
def _carry(  # type: ignore[no-untyped-def]
    points, ends, grid, across, cells, nodal, answer, cell, bary, moved, steps, signals, bent
):
    locate_along_path(points, grid, across, cell, bary)
    _move(cell, bary, cells, nodal, moved)
    lengths, shares = np.empty(steps.shape[1]), np.empty(len(points))
    for c in range(len(ends) - 1):
        _signal(
            points, moved, ends[c], ends[c + 1], answer, steps, shares, lengths, signals[c], bent
        )


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def _pulls(ends, moved, steps, weights, bent, out):  # type: ignore[no-untyped-def]
    """Fill weighted unit vectors (p + 1, 3 s) of the segments that end at each point.

    The weights are the line's `weights` (m, s) and, if any, the segment's derivatives `bent[0]`.
    The vectors are zero at the start of a line and after the last point.
    """
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
    points, ends, cells, by_bary, nodal, cell, bary, moved, steps, signals, bent, out
):
    states = steps.shape[1]
    one, two = states, 2 * states
    weights = np.ascontiguousarray(signals[:, 1])
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
        for p in range(ends[c] + 1, ends[c + 1]):
            inverse = 1 / _segment_length(points, p)
            for a in range(3):
                step = inverse * (points[p, a] - points[p - 1, a])
                for s in range(states):
                    out[p, a, s] += step * signals[c, 2, s]
                for s in range(states):
                    out[p - 1, a, s] -= step * signals[c, 2, s]
                if bent.size:
                    for s in range(states):
                        out[p, a, s] += step * weights[c, s] * bent[1, p, s]
                    for s in range(states):
                        out[p - 1, a, s] -= step * weights[c, s] * bent[1, p, s]


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def _pull(  # type: ignore[no-untyped-def]
    points, ends, cells, by_bary, nodal, by_signals, cell, bary, moved, steps, signals, bent, out
):
    """`_slopes` times `by_signals` (s, m)."""
    states = steps.shape[1]
    weights = np.empty((len(ends) - 1, states))
    for c in range(len(weights)):
        for s in range(states):
            weights[c, s] = by_signals[s, c] * signals[c, 1, s]
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
            rest -= by_signals[s, c] * signals[c, 2, s]
        for p in range(ends[c] + 1, ends[c + 1]):
            own = rest
            if bent.size:
                for s in range(states):
                    own -= weights[c, s] * bent[1, p, s]
            inverse = own / _segment_length(points, p)
            for a in range(3):
                step = inverse * (points[p, a] - points[p - 1, a])
                out[p, a] -= step
                out[p - 1, a] += step
