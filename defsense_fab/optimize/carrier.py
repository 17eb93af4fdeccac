"""Cords carried along by the simulated fields: signals, and what they gain as the cords move.

The fused loops behind the objective and the candidates: a point is found in its tet, moved by
every state at once, and, backwards, the derivative by its rest position is gathered without ever
forming the deformation gradients. `sensing/signal.py` defines the signal.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from ..core.arrays import Float, Int
from ..mechanics.locate import PointLocator, find_point
from ..mechanics.tet10 import EDGES
from ..mechanics.threads import cores, over_chunks

_CHUNK = 50  # paths; fewer are not worth a thread


class Carrier:
    """Fields (s, n, 3) mm on the locator's mesh, kept node by node for speed."""

    def __init__(self, locator: PointLocator, fields: Float, gauge_factor: float) -> None:
        self._mesh, self._locator, self._gauge = locator.mesh, locator, gauge_factor
        self._states = len(fields)
        self._nodal = np.ascontiguousarray(fields.transpose(1, 0, 2)).reshape(len(fields[0]), -1)

    def signals(self, paths: Float) -> Float:
        """(s, c) of polylines (c, p, 3) mm."""
        paths = np.ascontiguousarray(paths, float)
        out = np.empty((len(paths), self._states))

        def work(a: int, b: int) -> None:
            _signals(
                paths, self._locator.grid, self._mesh.cells, self._nodal, self._gauge, a, b, out
            )

        over_chunks(work, len(paths), cores(), _CHUNK)
        return np.ascontiguousarray(out.T)

    def move(self, points: Float) -> Float:
        """Deformed positions (s, p, 3) of points (p, 3) mm."""
        points = np.ascontiguousarray(points, float)
        out = np.empty((len(points), 3 * self._states))

        def work(a: int, b: int) -> None:
            _moved(points, self._locator.grid, self._mesh.cells, self._nodal, a, b, out)

        over_chunks(work, len(points), cores(), 40 * _CHUNK)
        return np.ascontiguousarray(out.reshape(len(points), -1, 3).swapaxes(0, 1))

    def tape(self, points: Float, ends: Int) -> tuple[Float, Callable[[Float], Float]]:
        """Signals (s, m) of polylines laid end to end, points (p, 3), line i being points
        `ends[i]` to `ends[i + 1]`; and the function that turns derivatives by the signals (s, m)
        into those by the points (p, 3)."""
        count = len(ends) - 1
        cell = np.empty(len(points), np.int64)
        bary = np.empty((len(points), 4))
        moved = np.empty((len(points), 3 * self._states))
        lengths = np.empty((count, self._states + 1))
        out = np.empty((self._states, count))
        _forward(
            points, ends, self._locator.grid, self._mesh.cells, self._nodal, self._gauge,
            cell, bary, moved, lengths, out,
        )  # fmt: skip

        def pull(weights: Float) -> Float:
            gradient = np.empty((len(points), 3))
            _backward(
                points, ends, self._mesh.cells, self._mesh.bary_gradient, self._nodal, self._gauge,
                cell, bary, moved, lengths, weights, gradient,
            )  # fmt: skip
            return gradient

        return out, pull


@numba.njit(cache=True, nogil=True, inline="always")
def _move(point, bary, nodes, nodal, out):  # type: ignore[no-untyped-def]
    """Deformed positions (3 s,) of a point in all states."""
    for k in range(0, len(out), 3):
        out[k], out[k + 1], out[k + 2] = point[0], point[1], point[2]
    for n in range(10):
        if n < 4:
            w = bary[n] * (2 * bary[n] - 1)
        else:
            w = 4 * bary[EDGES[n - 4, 0]] * bary[EDGES[n - 4, 1]]
        u = nodal[nodes[n]]
        for k in range(len(out)):
            out[k] += w * u[k]


@numba.njit(cache=True, nogil=True)
def _moved(points, grid, cells, nodal, start, stop, out):  # type: ignore[no-untyped-def]
    cell, bary = 0, np.empty(4)
    for p in range(start, stop):
        cell = find_point(points[p], grid, cell, bary)
        _move(points[p], bary, cells[cell], nodal, out[p])


@numba.njit(cache=True, nogil=True)
def _signals(paths, grid, cells, nodal, gauge, start, stop, out):  # type: ignore[no-untyped-def]
    width = nodal.shape[1]
    now, before, bary = np.empty(width), np.empty(width), np.empty(4)
    cell = 0
    for c in range(start, stop):
        total = 0.0
        out[c] = 0.0
        for p in range(paths.shape[1]):
            cell = find_point(paths[c, p], grid, cell, bary)
            _move(paths[c, p], bary, cells[cell], nodal, now)
            if p > 0:
                total += _distance(paths[c, p], paths[c, p - 1], 0)
                for s in range(width // 3):
                    out[c, s] += _distance(now, before, 3 * s)
            now, before = before, now
        for s in range(width // 3):
            out[c, s] = gauge * (out[c, s] / total - 1)


@numba.njit(cache=True, nogil=True, inline="always")
def _distance(a, b, k):  # type: ignore[no-untyped-def]
    x, y, z = a[k] - b[k], a[k + 1] - b[k + 1], a[k + 2] - b[k + 2]
    return np.sqrt(x * x + y * y + z * z)


@numba.njit(cache=True, nogil=True)
def _forward(  # type: ignore[no-untyped-def]
    points, ends, grid, cells, nodal, gauge, cell, bary, moved, lengths, out
):
    hint = 0
    for p in range(len(points)):
        hint = find_point(points[p], grid, hint, bary[p])
        cell[p] = hint
        _move(points[p], bary[p], cells[hint], nodal, moved[p])
    for c in range(len(ends) - 1):
        lengths[c] = 0.0
        for p in range(ends[c] + 1, ends[c + 1]):
            lengths[c, -1] += _distance(points[p], points[p - 1], 0)
            for s in range(len(out)):
                lengths[c, s] += _distance(moved[p], moved[p - 1], 3 * s)
        for s in range(len(out)):
            out[s, c] = gauge * (lengths[c, s] / lengths[c, -1] - 1)


@numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _backward(  # type: ignore[no-untyped-def]
    points, ends, cells, by_bary, nodal, gauge, cell, bary, moved, lengths, weights, gradient
):
    width = nodal.shape[1]
    v = np.empty(width)  # derivative by the deformed point, all states
    for c in range(len(ends) - 1):
        total = lengths[c, -1]
        shrink = 0.0
        for s in range(width // 3):
            shrink += weights[s, c] * gauge * lengths[c, s] / (total * total)
        for p in range(ends[c], ends[c + 1]):
            v[:] = 0.0
            g0 = g1 = g2 = 0.0
            for side in (-1, 1):
                q = p + side
                if q < ends[c] or q >= ends[c + 1]:
                    continue
                size = shrink / _distance(points[p], points[q], 0)
                g0 -= size * (points[p, 0] - points[q, 0])
                g1 -= size * (points[p, 1] - points[q, 1])
                g2 -= size * (points[p, 2] - points[q, 2])
                for s in range(width // 3):
                    k = 3 * s
                    size = weights[s, c] * gauge / total / _distance(moved[p], moved[q], k)
                    v[k] += size * (moved[p, k] - moved[q, k])
                    v[k + 1] += size * (moved[p, k + 1] - moved[q, k + 1])
                    v[k + 2] += size * (moved[p, k + 2] - moved[q, k + 2])
            for s in range(width // 3):
                g0 += v[3 * s]
                g1 += v[3 * s + 1]
                g2 += v[3 * s + 2]
            e = cell[p]
            for n in range(10):
                u = nodal[cells[e, n]]
                pull = 0.0
                for k in range(width):
                    pull += v[k] * u[k]
                if n < 4:
                    w = 4 * bary[p, n] - 1
                    g0 += pull * w * by_bary[e, n, 0]
                    g1 += pull * w * by_bary[e, n, 1]
                    g2 += pull * w * by_bary[e, n, 2]
                else:
                    i, j = EDGES[n - 4, 0], EDGES[n - 4, 1]
                    a, b = 4 * pull * bary[p, j], 4 * pull * bary[p, i]
                    g0 += a * by_bary[e, i, 0] + b * by_bary[e, j, 0]
                    g1 += a * by_bary[e, i, 1] + b * by_bary[e, j, 1]
                    g2 += a * by_bary[e, i, 2] + b * by_bary[e, j, 2]
            gradient[p, 0], gradient[p, 1], gradient[p, 2] = g0, g1, g2
