"""The local half of as-rigid-as-possible: each vertex' rotation, and what it asks of its edges.

O. Sorkine, M. Alexa, "As-rigid-as-possible surface modeling", SGP 2007: the energy of spokes,
sum_i sum_j w_ij |(x_j - x_i) - R_i c_ij|^2 over the half edges (i, j), of cotangent weights w and
edges at rest c. It is the one that libigl names ARAP_ENERGY_TYPE_SPOKES. Each half edge has its c:
where a vertex is strained, it is not the edge of the undeformed body.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row
from .rotation import LANES, nearest_of_many, nearest_rotation


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
