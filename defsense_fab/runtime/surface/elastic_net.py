"""The half edges of a surface and its factored Laplacian, and the local step of ARAP.

The energy of spokes is sum_i sum_j w_ij |(x_j - x_i) - R_i c_ij|^2 over the half edges (i, j), with
cotangent weights w and edges at rest c. It is libigl's ARAP_ENERGY_TYPE_SPOKES. Each half edge has
its own c: where a vertex is strained, it is not the edge of the undeformed body.

References:
    O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", SGP 2007.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array

from ...core.arrays import Bool, Float, Int
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row
from .rotation import LANES, nearest_of_many, nearest_rotation
from .sparse_factor import SparseFactor
from .surface_mesh import laplacian, vertex_areas


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def rotate_edges(
    ptr: Int, ends: Int, weights: Float, edges: Float, rotations: Float, right: Float
) -> None:
    """Add the divergence of rotated edges to the right side of the Laplacian.

    Args:
        ptr: Start of each vertex' half edges (n + 1,).
        ends: Vertices that the half edges lead to (h,).
        weights: Cotangent weights (h,).
        edges: Edges before the rotation (h, 3), mm.
        rotations: Rotations of the vertices that the edges start from (n, 9).
        right: Right side (3, n) that is added to.
    """
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
) -> None:
    """Fit the rotation of each vertex, and add the rotated edges to the right side.

    Args:
        ptr: Start of each vertex' half edges (n + 1,).
        ends: Vertices that the half edges lead to (h,).
        weights: Cotangent weights (h,).
        edges: Edges before the rotation (h, 3), mm.
        x: Vertices (n, 3), mm.
        rotations: Rotations (n, 9), replaced, but kept where the edges determine none.
        right: Right side (3, n) of the Laplacian that is added to.
    """
    n = len(ptr) - 1
    entries, converged = np.zeros(9 * LANES), np.zeros(LANES)
    original = np.zeros(9 * LANES)
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
        copy_row(entries, original)
        nearest_of_many(entries, converged)
        for lane in range(count):
            i = first + lane
            if converged[lane] > 0.0:
                for q in range(9):
                    rotations[i, q] = entries[q * LANES + lane]
            else:
                m = original[lane::LANES]
                exists, r = nearest_rotation(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8])
                if exists:
                    for q in range(9):
                        rotations[i, q] = r[q]
    rotate_edges(ptr, ends, weights, edges, rotations, right)


@compiled(fastmath=True)
def energy(ptr: Int, ends: Int, weights: Float, edges: Float, x: Float, rotations: Float) -> float:
    """Return the energy of the spokes, mm^2: weights have no unit."""
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


_GROUND_STIFFNESS = 1e-6  # of the slowest mode, for surfaces without fixed vertices


@dataclass(frozen=True)
class ElasticNet:
    """The half edges of a surface, and its factored Laplacian, in the order of the factor.

    Attributes:
        order: Vertex of the caller at each position (n,).
        rest: Vertices at rest (n, 3), mm.
        triangles: Triangles (f, 3).
        ptr: Start of each vertex' half edges (n + 1,).
        ends: Vertices that the half edges lead to (h,).
        weights: Cotangent weights (h,).
        edges: Half edges at rest (h, 3), mm.
        area: Areas of the vertices (n,), mm^2.
        fixed: Whether vertices are fixed (n,).
        held: Contribution of fixed vertices to the right side (3, n).
        ground: Stiffness that keeps a surface without fixed vertices where it was (n,).
        factor: Factor of the Laplacian.
    """

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
        """Set up the net of a surface at rest."""
        matrix = laplacian(vertices, triangles)
        area = vertex_areas(vertices, triangles)
        ground = np.zeros(len(vertices))
        if not fixed.any():
            slowest = np.pi**2 / float((np.ptp(vertices, axis=0) ** 2).sum())
            ground = _GROUND_STIFFNESS * slowest * area
        free = diags_array((~fixed).astype(float))
        system = csr_array(
            free @ matrix @ free + diags_array(ground) + diags_array(fixed.astype(float))
        )
        factor = SparseFactor.of(system)
        order = factor.order
        position = np.empty_like(order)
        position[order] = np.arange(len(order))
        rest, fixed = np.ascontiguousarray(vertices[order]), fixed[order]
        matrix = csr_array(matrix[order][:, order])
        between = (diags_array(matrix.diagonal()) - matrix).tocsr()
        between.eliminate_zeros()
        between.sort_indices()
        ptr, ends = (a.astype(np.int64) for a in (between.indptr, between.indices))
        tails = np.repeat(np.arange(len(order)), np.diff(ptr))
        held = np.where(fixed, rest.T, (between @ np.where(fixed[:, None], rest, 0.0)).T)
        return cls(
            order,
            rest,
            position[triangles],
            ptr,
            ends,
            between.data.copy(),
            rest[ends] - rest[tails],
            area[order],
            fixed,
            held,
            ground[order],
            factor,
        )

    @cached_property
    def tails(self) -> Int:
        """Vertices that the half edges start from (h,)."""
        return np.repeat(np.arange(len(self.rest)), np.diff(self.ptr))

    def rotations(self, x: Float, edges: Float | None = None) -> Float:
        """Return rotations (n, 9), row by row, from edges (h, 3) to vertices x (n, 3)."""
        out = self.no_rotations()
        c = self.edges if edges is None else edges
        fit_rotations(self.ptr, self.ends, self.weights, c, x, out, np.zeros((3, len(x))))
        return out

    def no_rotations(self) -> Float:
        """Return identities (n, 9)."""
        return np.tile(np.eye(3).ravel(), (len(self.rest), 1))

    def integrate(self, right: Float, before: Float) -> Float:
        """Return the vertices (n, 3), mm, whose Laplacian is nearest to a right side.

        Args:
            right: Right side (3, n), overwritten.
            before: Former vertices (n, 3), mm.
        """
        right[:, self.fixed] = 0.0
        right += self.held
        if not self.fixed.any():
            right += self.ground * before.T
        self.factor.solve(right)
        return np.ascontiguousarray(right.T)

    def responses(self, loads: Float) -> Float:
        """Return the responses (n, k) to loads (n, k) on free vertices, column by column."""
        out = np.array(loads.T, float, order="C")
        out[:, self.fixed] = 0.0
        padded = np.zeros((-(-len(out) // 3) * 3, out.shape[1]))
        padded[: len(out)] = out
        for k in range(0, len(padded), 3):
            block = padded[k : k + 3]
            self.factor.solve(block)
        return np.ascontiguousarray(padded[: len(out)].T)

    def energy(self, x: Float, rotations: Float, edges: Float | None = None) -> float:
        """Return the energy of the spokes, mm^2."""
        c = self.edges if edges is None else edges
        return float(energy(self.ptr, self.ends, self.weights, c, x, rotations))
