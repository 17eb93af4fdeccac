"""A surface's half edges and its Laplacian, factored once: what every mode of solving shares."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array

from ...core.arrays import Bool, Float, Int
from .dissection import elimination_order
from .local_step import energy, fit_rotations
from .mesh_operators import laplacian, vertex_areas
from .sparse_factor import SparseFactor

_GROUND = 1e-6  # of the slowest mode, of a surface of which nothing is fixed


@dataclass(frozen=True)
class ElasticNet:
    """`rest` (n, 3) mm and all else in the factor's order, which has vertex `order[k]` of the
    caller at place k; `triangles` (f, 3); half edges of vertex i are `ptr[i]` to `ptr[i + 1]`, go
    to `ends`, with cotangent `weights`, `edges` (h, 3) at rest; `area` (n,) mm^2; `fixed` (n,);
    `held` (3, n) is what fixed vertices add to the right side, `ground` (n,) what keeps a surface
    of which nothing is fixed from drifting: it is kept where it was."""

    order: Int
    rest: Float
    triangles: Int
    ptr: Int
    ends: Int
    weights: Float
    edges: Float
    area: Float
    fixed: Bool
    held: Float
    ground: Float
    factor: SparseFactor

    @classmethod
    def of(cls, vertices: Float, triangles: Int, fixed: Bool) -> ElasticNet:
        """Of a surface at rest."""
        matrix = laplacian(vertices, triangles)
        area = vertex_areas(vertices, triangles)
        ground = np.zeros(len(vertices))
        if not fixed.any():
            slowest = np.pi**2 / float((np.ptp(vertices, axis=0) ** 2).sum())
            ground = _GROUND * slowest * area
        free = diags_array((~fixed).astype(float))
        kept = csr_array(
            free @ matrix @ free + diags_array(ground) + diags_array(fixed.astype(float))
        )
        ptr, ends = (a.astype(np.int64) for a in (matrix.indptr, matrix.indices))
        factor = SparseFactor.of(kept, elimination_order(vertices, ptr, ends))
        order = factor.order
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        rest, fixed = np.ascontiguousarray(vertices[order]), fixed[order]
        matrix = csr_array(matrix[order][:, order])
        between = (diags_array(matrix.diagonal()) - matrix).tocsr()
        between.eliminate_zeros()
        between.sort_indices()
        ptr, ends = (a.astype(np.int64) for a in (between.indptr, between.indices))
        tails = np.repeat(np.arange(len(order)), np.diff(ptr))
        held = np.where(fixed, rest.T, (between @ np.where(fixed[:, None], rest, 0.0)).T)
        return cls(
            order, rest, place[triangles], ptr, ends, between.data.copy(), rest[ends] - rest[tails],
            area[order], fixed, held, ground[order], factor,
        )  # fmt: skip

    @cached_property
    def tails(self) -> Int:
        """(h,) the vertex that each half edge starts from."""
        return np.repeat(np.arange(len(self.rest)), np.diff(self.ptr))

    def rotations(self, x: Float, edges: Float | None = None) -> Float:
        """(n, 9) row by row, of vertices x (n, 3), from edges (h, 3) before the rotation."""
        out = self.no_rotations()
        c = self.edges if edges is None else edges
        fit_rotations(self.ptr, self.ends, self.weights, c, x, out, np.zeros((3, len(x))))
        return out

    def no_rotations(self) -> Float:
        """(n, 9)."""
        return np.tile(np.eye(3).ravel(), (len(self.rest), 1))

    def integrate(self, right: Float, before: Float) -> Float:
        """Vertices (n, 3) mm whose Laplacian is nearest to `right` (3, n), which is overwritten;
        `before` (n, 3) is where they were."""
        right[:, self.fixed] = 0.0
        right += self.held
        if not self.fixed.any():
            right += self.ground * before.T
        self.factor.solve(right)
        return np.ascontiguousarray(right.T)

    def responses(self, loads: Float) -> Float:
        """(n, k) of loads (n, k) on free vertices, columns by themselves."""
        out = np.array(loads.T, float, order="C")
        out[:, self.fixed] = 0.0
        padded = np.zeros((-(-len(out) // 3) * 3, out.shape[1]))
        padded[: len(out)] = out
        for k in range(0, len(padded), 3):
            block = padded[k : k + 3]
            self.factor.solve(block)
        return np.ascontiguousarray(padded[: len(out)].T)

    def energy(self, x: Float, rotations: Float, edges: Float | None = None) -> float:
        """Of the spokes, mm^2."""
        c = self.edges if edges is None else edges
        return float(energy(self.ptr, self.ends, self.weights, c, x, rotations))
