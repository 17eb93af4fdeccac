"""A surface's half edges and its Laplacian, factored once: what every mode of solving shares."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array

from ...core.arrays import Bool, Float, Int
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row
from .rotation import LANES, nearest_of_many, nearest_rotation
from .sparse_factor import SparseFactor, elimination_order
from .surface_mesh import laplacian, vertex_areas

# The local half of as-rigid-as-possible: each vertex' rotation, and what it asks of its edges.
#
# O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", SGP 2007: the energy of spokes,
# sum_i sum_j w_ij |(x_j - x_i) - R_i c_ij|^2 over the half edges (i, j), of cotangent weights w and
# edges at rest c. It is the one that libigl names ARAP_ENERGY_TYPE_SPOKES. Each half edge has its c:
# where a vertex is strained, it is not the edge of the undeformed body.


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def rotate_edges(
    ptr: Int, ends: Int, weights: Float, edges: Float, rotations: Float, right: Float
) -> None:  # fmt: skip
    """Add what edges (h, 3), turned by `rotations` (n, 9) of the vertices that they start from, ask
    of the Laplacian to `right` (3, n)."""
    bx, by, bz = right[0], right[1], right[2]
    for i in range(len(ptr) - 1):
        r = rotations[i]
        s0, s1, s2 = 0.0, 0.0, 0.0
        for p in range(ptr[i], ptr[i + 1]):
            j, w = ends[p], 0.5 * weights[p]
            c0, c1, c2 = w * edges[p, 0], w * edges[p, 1], w * edges[p, 2]
            t0 = r[0] * c0 + r[1] * c1 + r[2] * c2
            t1 = r[3] * c0 + r[4] * c1 + r[5] * c2
            t2 = r[6] * c0 + r[7] * c1 + r[8] * c2
            s0 += t0
            s1 += t1
            s2 += t2
            bx[j] += t0
            by[j] += t1
            bz[j] += t2
        bx[i] -= s0
        by[i] -= s1
        bz[i] -= s2


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def fit_rotations(
    ptr: Int, ends: Int, weights: Float, edges: Float, x: Float, rotations: Float, right: Float
) -> None:  # fmt: skip
    """Of vertices x (n, 3): half edges of vertex i are `ptr[i]` to `ptr[i + 1]` and go to `ends`,
    `edges` (h, 3) at rest. `rotations` (n, 9) are replaced, and kept where edges fix none; what
    they ask of the Laplacian of x is added to `right` (3, n)."""
    n = len(ptr) - 1
    entries, settled = np.zeros(9 * LANES), np.zeros(LANES)
    kept = np.zeros(9 * LANES)
    for first in range(0, n, LANES):
        count = min(LANES, n - first)
        for lane in range(count):
            i = first + lane
            a, b, c, d, e, f, g, h, k = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
            for p in range(ptr[i], ptr[i + 1]):
                j, w = ends[p], weights[p]
                d0, d1, d2 = w * (x[j, 0] - x0), w * (x[j, 1] - x1), w * (x[j, 2] - x2)
                c0, c1, c2 = edges[p, 0], edges[p, 1], edges[p, 2]
                a += d0 * c0
                b += d0 * c1
                c += d0 * c2
                d += d1 * c0
                e += d1 * c1
                f += d1 * c2
                g += d2 * c0
                h += d2 * c1
                k += d2 * c2
            entries[lane], entries[LANES + lane], entries[2 * LANES + lane] = a, b, c
            entries[3 * LANES + lane], entries[4 * LANES + lane] = d, e
            entries[5 * LANES + lane], entries[6 * LANES + lane] = f, g
            entries[7 * LANES + lane], entries[8 * LANES + lane] = h, k
        copy_row(entries, kept)
        nearest_of_many(entries, settled)
        for lane in range(count):
            i = first + lane
            if settled[lane] > 0.0:
                for q in range(9):
                    rotations[i, q] = entries[q * LANES + lane]
            else:
                m = kept[lane::LANES]
                found, r = nearest_rotation(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8])
                if found:
                    for q in range(9):
                        rotations[i, q] = r[q]
    rotate_edges(ptr, ends, weights, edges, rotations, right)


@compiled(fastmath=True)
def energy(ptr: Int, ends: Int, weights: Float, edges: Float, x: Float, rotations: Float) -> float:
    """Of the spokes, in mm^2: weights have no unit."""
    total = 0.0
    for i in range(len(ptr) - 1):
        r = rotations[i]
        for p in range(ptr[i], ptr[i + 1]):
            j = ends[p]
            c0, c1, c2 = edges[p, 0], edges[p, 1], edges[p, 2]
            t0 = x[j, 0] - x[i, 0] - (r[0] * c0 + r[1] * c1 + r[2] * c2)
            t1 = x[j, 1] - x[i, 1] - (r[3] * c0 + r[4] * c1 + r[5] * c2)
            t2 = x[j, 2] - x[i, 2] - (r[6] * c0 + r[7] * c1 + r[8] * c2)
            total += weights[p] * (t0 * t0 + t1 * t1 + t2 * t2)
    return total


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
