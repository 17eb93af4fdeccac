"""Locate points in a mesh and interpolate displacements and their gradients there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine import kernels
from .tet10 import QuadraticMesh, shape_functions
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
        grid: The grid's arrays, as compiled loops take them.
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
        start = np.zeros(self._count.prod() + 1, np.int64)
        kernels.fill_grid(a, b, self._count, start, np.empty(0, np.int64))
        start = np.cumsum(start)
        items = np.empty(start[-1], np.int64)
        kernels.fill_grid(a, b, self._count, start, items)
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
            lambda a, b: kernels.find_points(points, self.grid, a, b, cell, bary),
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
        fields, out = np.ascontiguousarray(fields, float), np.empty((len(fields), len(nodes), 3))
        run_in_chunks(
            lambda a, b: kernels.interpolate(nodes, weights, fields, a, b, out),
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
        fields, out = np.ascontiguousarray(fields, float), np.empty((len(fields), count, 3, 3))
        run_in_chunks(
            lambda a, b: kernels.interpolate_gradients(
                mesh.cells, mesh.bary_gradient, at.cell, at.bary, fields, a, b, out
            ),
            count,
            count_cores(),
            CHUNK_POINTS,
        )
        return out


def face_neighbors(tets: Int) -> Int:
    """Return for tets (m, 4) the tet (m, 4) that shares the face opposite each corner, or -1."""
    faces = np.sort(tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    order = np.lexsort(faces.T)
    same = (faces[order[1:]] == faces[order[:-1]]).all(axis=1)
    a, b = order[:-1][same], order[1:][same]
    out = np.full(len(faces), -1)
    out[a], out[b] = b // 4, a // 4
    return out.reshape(-1, 4)


def locate_along_path(points: Float, grid: Any, across: Int, cells: Int, bary: Float) -> None:
    """Locate the points (p, 3) mm of a path by walking through faces from one tet to the next.

    Gives the same tets as `PointLocator.find` inside the mesh.

    Args:
        points: The points.
        grid: The `grid` of a `PointLocator`.
        across: Its `opposite_tets`.
        cells: Filled with the tets (p,).
        bary: Filled with the barycentric coordinates (p, 4).
    """
    kernels.locate_along_path(points, grid, across, cells, bary)
