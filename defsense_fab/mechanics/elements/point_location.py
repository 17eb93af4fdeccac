"""Locate points in a mesh and interpolate displacements and their gradients there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled
from .tet10 import EDGES, QuadraticMesh, shape_functions
from .threads import count_cores, run_in_chunks

CHUNK_POINTS = 2000  # fewer are not worth a thread


@dataclass(frozen=True)
class LocatedPoints:
    """Points of a mesh by their tets.

    Attributes:
        cell: (p,) number of the tet of each point, the nearest tet for points outside.
        bary: (p, 4) barycentric coordinates in that tet.
    """

    cell: Int
    bary: Float

    @property
    def depth(self) -> Float:
        """Smallest barycentric coordinate (p,); negative for points outside the mesh."""
        return np.asarray(self.bary.min(axis=1))


class PointLocator:
    """Finds the tets of points by a uniform grid over the tets' bounding boxes.

    Args:
        mesh: The mesh, at rest.

    Attributes:
        mesh: The same mesh.
        grid: The grid's arrays, as `find_point` takes them.
    """

    def __init__(self, mesh: QuadraticMesh) -> None:
        self.mesh = mesh
        corners = mesh.nodes[mesh.cells[:, :4]]
        low, high = corners.min(1), corners.max(1)
        self._low = low.min(0) - 1e-9
        self._cell = float(np.median((high - low).max(1)))
        self._count = np.maximum(np.ceil((high.max(0) - self._low) / self._cell), 1).astype(int)
        a = np.floor((low - self._low) / self._cell).astype(int)
        b = np.minimum(np.floor((high - self._low) / self._cell).astype(int), self._count - 1)
        start, items = _fill(a, b, self._count)
        self.grid = (
            self._low, self._cell, self._count, start, items,
            np.ascontiguousarray(corners[:, 0]), mesh.bary_gradient,
        )  # fmt: skip

    @cached_property
    def opposite_tets(self) -> Int:
        """Number (m, 4) of the tet behind the face opposite each corner, -1 at the surface."""
        return face_neighbors(self.mesh.cells[:, :4])

    def find(self, points: Float) -> LocatedPoints:
        """Locate points (p, 3) mm of the rest frame; points outside get the nearest tet."""
        points = np.ascontiguousarray(points, float)
        cell, bary = np.zeros(len(points), np.int64), np.empty((len(points), 4))
        run_in_chunks(
            lambda a, b: _find(points, self.grid, a, b, cell, bary),
            len(points),
            count_cores(),
            CHUNK_POINTS,
        )
        return LocatedPoints(cell, bary)

    def displacement(self, at: LocatedPoints, fields: Float) -> Float:
        """Interpolate displacement fields.

        Outside the mesh the nearest tet's polynomial is continued.

        Args:
            at: The located points (p).
            fields: Nodal displacements (s, n, 3) mm of s states.

        Returns:
            Displacements (s, p, 3) mm at the points.
        """
        nodes, weights = self.mesh.cells[at.cell], shape_functions(at.bary)
        out = np.zeros((len(fields), len(nodes), 3))
        run_in_chunks(
            lambda a, b: _displacement(nodes, weights, fields, a, b, out),
            len(nodes),
            count_cores(),
            CHUNK_POINTS,
        )
        return out

    def gradient(self, at: LocatedPoints, fields: Float) -> Float:
        """Interpolate displacement gradients.

        Args:
            at: The located points (p).
            fields: Nodal displacements (s, n, 3) mm of s states.

        Returns:
            Gradients (s, p, 3, 3); entry [a, j] is the derivative of u_a by X_j.
        """
        mesh, count = self.mesh, len(at.cell)
        out = np.zeros((len(fields), count, 3, 3))
        run_in_chunks(
            lambda a, b: _gradient(
                mesh.cells, mesh.bary_gradient, at.cell, at.bary, fields, a, b, out
            ),
            count,
            count_cores(),
            CHUNK_POINTS,
        )
        return out


@compiled()
def _displacement(nodes, weights, fields, start, stop, out):  # type: ignore[no-untyped-def]
    for s in range(len(fields)):
        for p in range(start, stop):
            for n in range(10):
                for a in range(3):
                    out[s, p, a] += weights[p, n] * fields[s, nodes[p, n], a]


@compiled()
def _gradient(cells, by_bary, at, bary, fields, start, stop, out):  # type: ignore[no-untyped-def]
    g = np.empty((10, 3))
    for p in range(start, stop):
        e, b = at[p], bary[p]
        for j in range(3):
            for n in range(4):
                g[n, j] = (4 * b[n] - 1) * by_bary[e, n, j]
            for k in range(6):
                n, m = EDGES[k, 0], EDGES[k, 1]
                g[4 + k, j] = 4 * (b[m] * by_bary[e, n, j] + b[n] * by_bary[e, m, j])
        for s in range(len(fields)):
            for n in range(10):
                for a in range(3):
                    u = fields[s, cells[e, n], a]
                    for j in range(3):
                        out[s, p, a, j] += u * g[n, j]


@compiled()
def _fill(a, b, count):  # type: ignore[no-untyped-def]
    start = np.zeros(count[0] * count[1] * count[2] + 1, np.int64)
    for turn in range(2):
        if turn == 1:
            start = np.cumsum(start)
            items = np.empty(start[-1], np.int64)
            fill = start.copy()
        for e in range(len(a)):
            for i in range(a[e, 0], b[e, 0] + 1):
                for j in range(a[e, 1], b[e, 1] + 1):
                    for k in range(a[e, 2], b[e, 2] + 1):
                        c = (i * count[1] + j) * count[2] + k
                        if turn == 0:
                            start[c + 1] += 1
                        else:
                            items[fill[c]] = e
                            fill[c] += 1
    return start, items


@compiled()
def _find(points, grid, first, last, cells, bary):  # type: ignore[no-untyped-def]
    for p in range(first, last):
        hint = cells[p - 1] if p > first else np.int64(0)
        cells[p] = find_point(points[p], grid, hint, bary[p])


@compiled()
def _weights(point, e, origin, gradient, bary):  # type: ignore[no-untyped-def]
    """Fill the barycentric coordinates (4,) in tet e and return the smallest."""
    for b in range(4):
        bary[b] = 1.0 if b == 0 else 0.0
        for d in range(3):
            bary[b] += (point[d] - origin[e, d]) * gradient[e, b, d]
    return min(bary[0], bary[1], bary[2], bary[3])


def face_neighbors(tets: Int) -> Int:
    """Return for tets (m, 4) the tet (m, 4) that shares the face opposite each corner, or -1."""
    faces = np.sort(tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    order = np.lexsort(faces.T)
    same = (faces[order[1:]] == faces[order[:-1]]).all(axis=1)
    a, b = order[:-1][same], order[1:][same]
    out = np.full(len(faces), -1)
    out[a], out[b] = b // 4, a // 4
    return out.reshape(-1, 4)


@compiled(error_model="numpy")
def locate_along_path(points, grid, across, cells, bary):  # type: ignore[no-untyped-def]
    """Locate the points (p, 3) of a path by walking through faces from one tet to the next.

    Fills `cells` (p,) and the weights `bary` (p, 4); gives the same tets as `find_point` inside.
    """
    origin, gradient = grid[5], grid[6]
    at = np.int64(0)  # 0 has a type of its own, for which callees would be compiled once more
    for p in range(len(points)):
        e, inside = at, False
        for _ in range(8):
            x, y = points[p, 0] - origin[e, 0], points[p, 1] - origin[e, 1]
            z = points[p, 2] - origin[e, 2]
            bary[p, 0], lowest = 1.0, 0
            for i in range(1, 4):
                bary[p, i] = gradient[e, i, 0] * x + gradient[e, i, 1] * y + gradient[e, i, 2] * z
                bary[p, 0] -= bary[p, i]
            for i in range(1, 4):
                lowest = i if bary[p, i] < bary[p, lowest] else lowest
            inside = bary[p, lowest] >= 0.0
            if inside or across[e, lowest] < 0:
                break
            e = across[e, lowest]
        at = e if inside else find_point(points[p], grid, at, bary[p])
        cells[p] = at


@compiled()
def find_point(point, grid, hint, bary):  # type: ignore[no-untyped-def]
    """Return the tet that holds a point (3,), starting at tet `hint`, and fill its weights (4,)."""
    low, size, count, start, items, origin, gradient = grid
    if _weights(point, hint, origin, gradient, bary) >= 1e-9:
        return hint
    x = min(max(int(np.floor((point[0] - low[0]) / size)), 0), count[0] - 1)
    y = min(max(int(np.floor((point[1] - low[1]) / size)), 0), count[1] - 1)
    z = min(max(int(np.floor((point[2] - low[2]) / size)), 0), count[2] - 1)
    best, cell = -np.inf, 0
    for reach in range(max(count[0], count[1], count[2])):
        for i in range(max(x - reach, 0), min(x + reach + 1, count[0])):
            for j in range(max(y - reach, 0), min(y + reach + 1, count[1])):
                for k in range(max(z - reach, 0), min(z + reach + 1, count[2])):
                    if max(abs(i - x), abs(j - y), abs(k - z)) != reach:
                        continue
                    c = (i * count[1] + j) * count[2] + k
                    for n in range(start[c], start[c + 1]):
                        m = _weights(point, items[n], origin, gradient, bary)
                        if m > best:
                            best, cell = m, items[n]
        if best >= -1e-12 or (best > -np.inf and reach >= 1):
            break
    _weights(point, cell, origin, gradient, bary)
    return cell
