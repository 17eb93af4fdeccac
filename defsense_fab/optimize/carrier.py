"""Cords carried along by the simulated fields: signals, and what they gain as the cords move.

The fused loops behind the objective and the candidates: a point is found in its tet, moved by
every state at once, and the derivatives by its rest position are gathered without ever forming
the deformation gradients. States lie innermost, so that the processor takes several at a time.
`sensing/signal.py` defines the signal.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from ..core.arrays import Float, Int
from ..mechanics.locate import PointLocator, walk_to_point
from ..mechanics.tet10 import EDGES
from ..mechanics.threads import cores, over_chunks

_CHUNK = 50  # paths; fewer are not worth a thread


class Carrier:
    """Fields (s, n, 3) mm on the locator's mesh, kept node by node for speed."""

    def __init__(self, locator: PointLocator, fields: Float, gauge_factor: float) -> None:
        self._mesh, self._locator, self._gauge = locator.mesh, locator, gauge_factor
        self._states = len(fields)
        self._nodal = np.ascontiguousarray(fields.transpose(1, 2, 0)).reshape(len(fields[0]), -1)

    def signals(self, paths: Float) -> Float:
        """(s, c) of polylines (c, p, 3) mm."""
        paths = np.ascontiguousarray(paths, float)
        out = np.empty((len(paths), self._states))

        def work(a: int, b: int) -> None:
            _signals(
                paths,
                self._locator.grid,
                self._locator.across,
                self._mesh.cells,
                self._nodal,
                self._gauge,
                a,
                b,
                out,
            )

        over_chunks(work, len(paths), cores(), _CHUNK)
        return np.ascontiguousarray(out.T)

    def move(self, points: Float) -> Float:
        """Deformed positions (s, p, 3) of points (p, 3) mm."""
        points = np.ascontiguousarray(points, float)
        out = np.empty((len(points), 3 * self._states))

        def work(a: int, b: int) -> None:
            _moved(
                points,
                self._locator.grid,
                self._locator.across,
                self._mesh.cells,
                self._nodal,
                a,
                b,
                out,
            )

        over_chunks(work, len(points), cores(), 40 * _CHUNK)
        return np.ascontiguousarray(out.reshape(len(points), 3, -1).transpose(2, 0, 1))

    def tape(self, points: Float, ends: Int) -> tuple[Float, Callable[[], Float]]:
        """Signals (s, m) of polylines laid end to end, points (p, 3), line i being points
        `ends[i]` to `ends[i + 1]`; and the function that gives the derivatives (p, 3, s) of each
        line's signals by its points."""
        cell = np.empty(len(points), np.int64)
        bary = np.empty((len(points), 4))
        moved = np.empty((len(points), 3 * self._states))
        lengths = np.empty((len(ends) - 1, self._states + 1))
        out = np.empty((len(ends) - 1, self._states))
        _forward(
            points, ends, self._locator.grid, self._locator.across, self._mesh.cells, self._nodal,
            self._gauge, cell, bary, moved, lengths, out,
        )  # fmt: skip

        def slopes() -> Float:
            by_points = np.empty((len(points), 3, self._states))
            _slopes(
                points, ends, self._mesh.cells, self._mesh.bary_gradient, self._nodal, self._gauge,
                cell, bary, moved, lengths, by_points,
            )  # fmt: skip
            return by_points

        return out.T, slopes


@numba.njit(cache=True, nogil=True)
def _weights(bary, out):  # type: ignore[no-untyped-def]
    """The ten shape functions, as in `tet10.shape`."""
    for n in range(4):
        out[n] = bary[n] * (2 * bary[n] - 1)
    for n in range(6):
        out[4 + n] = 4 * bary[EDGES[n, 0]] * bary[EDGES[n, 1]]


@numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _move(point, bary, nodes, nodal, w, out):  # type: ignore[no-untyped-def]
    """Deformed positions (3 s,) of a point in all states; `w` (10,) is for scratch. All ten terms
    at once: half the time of adding row by row to `out`."""
    _weights(bary, w)
    a, b, c, d, e = (nodal[nodes[0]], nodal[nodes[1]], nodal[nodes[2]], nodal[nodes[3]],
                     nodal[nodes[4]])  # fmt: skip
    f, g, h, i, j = (nodal[nodes[5]], nodal[nodes[6]], nodal[nodes[7]], nodal[nodes[8]],
                     nodal[nodes[9]])  # fmt: skip
    for k in range(len(out)):
        out[k] = (
            w[0] * a[k] + w[1] * b[k] + w[2] * c[k] + w[3] * d[k] + w[4] * e[k]
            + w[5] * f[k] + w[6] * g[k] + w[7] * h[k] + w[8] * i[k] + w[9] * j[k]
        )  # fmt: skip
    states = len(out) // 3
    for axis in range(3):
        for s in range(axis * states, (axis + 1) * states):
            out[s] += point[axis]


@numba.njit(cache=True, nogil=True)
def _moved(points, grid, across, cells, nodal, start, stop, out):  # type: ignore[no-untyped-def]
    cell, bary, w = 0, np.empty(4), np.empty(10)
    for p in range(start, stop):
        cell = walk_to_point(points[p], grid, across, cell, bary)
        _move(points[p], bary, cells[cell], nodal, w, out[p])


@numba.njit(cache=True, nogil=True)
def _signals(  # type: ignore[no-untyped-def]
    paths, grid, across, cells, nodal, gauge, start, stop, out
):
    states = nodal.shape[1] // 3
    now, before = np.empty(3 * states), np.empty(3 * states)
    cell, bary, w = 0, np.empty(4), np.empty(10)
    for c in range(start, stop):
        total = 0.0
        out[c] = 0.0
        for p in range(paths.shape[1]):
            cell = walk_to_point(paths[c, p], grid, across, cell, bary)
            _move(paths[c, p], bary, cells[cell], nodal, w, now)
            if p > 0:
                total += _distance(paths[c, p], paths[c, p - 1])
                _lengthen(now, before, states, out[c])
            now, before = before, now
        for s in range(states):
            out[c, s] = gauge * (out[c, s] / total - 1)


@numba.njit(cache=True, nogil=True, inline="always")
def _distance(a, b):  # type: ignore[no-untyped-def]
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return np.sqrt(x * x + y * y + z * z)


@numba.njit(cache=True, nogil=True)
def _lengthen(a, b, states, out):  # type: ignore[no-untyped-def]
    """Add the distances of two points (3 s,) to out (s,)."""
    for s in range(states):
        x, y, z = a[s] - b[s], a[states + s] - b[states + s], a[2 * states + s] - b[2 * states + s]
        out[s] += np.sqrt(x * x + y * y + z * z)


@numba.njit(cache=True, nogil=True)
def _forward(  # type: ignore[no-untyped-def]
    points, ends, grid, across, cells, nodal, gauge, cell, bary, moved, lengths, out
):
    hint, states, w = 0, out.shape[1], np.empty(10)
    for p in range(len(points)):
        hint = walk_to_point(points[p], grid, across, hint, bary[p])
        cell[p] = hint
        _move(points[p], bary[p], cells[hint], nodal, w, moved[p])
    for c in range(len(ends) - 1):
        lengths[c] = 0.0
        for p in range(ends[c] + 1, ends[c + 1]):
            lengths[c, states] += _distance(points[p], points[p - 1])
            _lengthen(moved[p], moved[p - 1], states, lengths[c])
        for s in range(states):
            out[c, s] = gauge * (lengths[c, s] / lengths[c, states] - 1)


@numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _units(moved, p, q, states, out):  # type: ignore[no-untyped-def]
    """Add to out (3 s,) the unit vectors from point q to point p, in every state."""
    for s in range(states):
        x = moved[p, s] - moved[q, s]
        y = moved[p, states + s] - moved[q, states + s]
        z = moved[p, 2 * states + s] - moved[q, 2 * states + s]
        inverse = 1 / np.sqrt(x * x + y * y + z * z)
        out[s] += inverse * x
        out[states + s] += inverse * y
        out[2 * states + s] += inverse * z


@numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _carried(v, nodes, nodal, g, states, out):  # type: ignore[no-untyped-def]
    """out (3, s) += grad(u)^T v, from the derivatives g (10, 3) of the shape functions."""
    for s in range(states):
        x = y = z = 0.0
        for n in range(10):
            e = nodes[n]
            pull = v[s] * nodal[e, s] + v[states + s] * nodal[e, states + s]
            pull += v[2 * states + s] * nodal[e, 2 * states + s]
            x += pull * g[n, 0]
            y += pull * g[n, 1]
            z += pull * g[n, 2]
        out[0, s] += x
        out[1, s] += y
        out[2, s] += z


@numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _slopes(  # type: ignore[no-untyped-def]
    points, ends, cells, by_bary, nodal, gauge, cell, bary, moved, lengths, out
):
    states = nodal.shape[1] // 3
    v = np.empty(3 * states)  # derivative of the deformed length by the deformed point
    rest, g = np.empty(3), np.empty((10, 3))
    for c in range(len(ends) - 1):
        total = lengths[c, states]
        for p in range(ends[c], ends[c + 1]):
            v[:] = 0.0
            rest[:] = 0.0
            for q in (p - 1, p + 1):
                if q < ends[c] or q >= ends[c + 1]:
                    continue
                inverse = 1 / _distance(points[p], points[q])
                for a in range(3):
                    rest[a] += inverse * (points[p, a] - points[q, a])
                _units(moved, p, q, states, v)
            for a in range(3):
                for s in range(states):
                    out[p, a, s] = v[a * states + s] - lengths[c, s] / total * rest[a]
            e, b = cell[p], bary[p]
            for a in range(3):
                for n in range(4):
                    g[n, a] = (4 * b[n] - 1) * by_bary[e, n, a]
                for n in range(6):
                    i, j = EDGES[n, 0], EDGES[n, 1]
                    g[4 + n, a] = 4 * (b[j] * by_bary[e, i, a] + b[i] * by_bary[e, j, a])
            _carried(v, cells[e], nodal, g, states, out[p])
            for a in range(3):
                for s in range(states):
                    out[p, a, s] *= gauge / total
