"""Compiled loops behind the objective and the candidates: cords in all states, and derivatives.

The derivatives of signals by the rest positions of points are gathered without forming deformation
gradients. The loops are written for speed, by a factor of several. States are the innermost index.
A loop over states writes to one array only; otherwise the compiler assumes that arrays may overlap
and does not vectorize it. Functions take whole paths, because passing an array costs as much as a
point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row
from ...mechanics.elements.point_location import locate_along_path
from ...mechanics.elements.tet10 import EDGES
from ...sensing.response import evaluate_response

_MIN_LENGTH_MM = 1e-300  # added to lengths, so that coincident points have zero derivatives
#: For each corner of a tet, the nodes on its three edges and the corners at their other ends.
_SPOKES = [[(4 + e, a + b - i) for e, (a, b) in enumerate(EDGES) if i in (a, b)] for i in range(4)]
_ON_EDGES, _BEYOND = (np.array([[s[k] for s in spokes] for spokes in _SPOKES]) for k in (0, 1))


class Tets(NamedTuple):
    """A mesh in all states, for compiled loops.

    Attributes:
        cells: (m, 10) nodes of the tets.
        by_bary: (m, 4, 3) gradients of the barycentric coordinates.
        nodal: (n, 3 s) mm, deformed positions of the nodes.
    """

    cells: Int
    by_bary: Float
    nodal: Float


class Lines(NamedTuple):
    """Polylines of p points in all states, as `carry_lines` fills them.

    Attributes:
        cell: (p,) tets of the points.
        bary: (p, 4) their barycentric coordinates.
        moved: (p, 3 s) mm, deformed positions.
        steps: (p, s) mm, deformed lengths of the segments that end at the points.
        signals: (m, 3, s), signals of the lines and their derivatives by strained and rest length.
        bent: (2, p, s) derivatives of the strained lengths by segments, or empty.
    """

    cell: Int
    bary: Float
    moved: Float
    steps: Float
    signals: Float
    bent: Float


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})
def move_points(cell, bary, cells, nodal, out):  # type: ignore[no-untyped-def]
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
def fill_signals(paths, where, tets, answer, out):  # type: ignore[no-untyped-def]
    """Fill `out` (c, s) with the signals of paths (c, p, 3) mm; `where` locates points."""
    grid, across = where
    count, states = paths.shape[1], out.shape[1]
    cell, bary = np.empty(count, np.int64), np.empty((count, 4))
    moved, steps = np.empty((count, 3 * states)), np.empty((count, states))
    lengths, shares, unused = np.empty(states), np.empty(count), np.empty((2, 0, states))
    found, first = np.empty((3, states)), np.int64(0)  # not 0: as in `point_location.walk`
    for c in range(len(paths)):
        locate_along_path(paths[c], grid, across, cell, bary)
        move_points(cell, bary, tets.cells, tets.nodal, moved)
        _signal(paths[c], moved, first, count, answer, steps, shares, lengths, found, unused)
        copy_row(found[0], out[c])


@compiled(error_model="numpy")
def carry_lines(points, ends, where, tets, answer, lines):  # type: ignore[no-untyped-def]
    """Fill `lines` for points (p, 3) mm of lines that end before the numbers `ends` (m + 1,)."""
    grid, across = where
    cell, bary, moved, steps, signals, bent = lines
    locate_along_path(points, grid, across, cell, bary)
    move_points(cell, bary, tets.cells, tets.nodal, moved)
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
def fill_slopes(points, ends, tets, lines, out):  # type: ignore[no-untyped-def]
    """Fill `out` (p, 3, s) with the derivatives of each line's signals by its points."""
    cells, by_bary, nodal = tets
    cell, bary, moved, steps, signals, bent = lines
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
def pull_signals(points, ends, tets, by_signals, lines, out):  # type: ignore[no-untyped-def]
    """Fill `out` (p, 3) with the derivatives of `fill_slopes` times `by_signals` (s, m)."""
    cells, by_bary, nodal = tets
    cell, bary, moved, steps, signals, bent = lines
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
