"""A coarse surface that carries a fine one along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled
from .mesh_operators import decimated, nearest_points
from .surface_basis import SurfaceBasis


@dataclass(frozen=True)
class Cage:
    """The coarse surface as a `basis` of its own; each of v fine vertices follows three of the
    cage's `corners` (v, 3) by `weights` (v, 3): it stands at `away` (v, 3, 3) mm from them at rest,
    and turns with each (linear blend skinning)."""

    basis: SurfaceBasis
    corners: Int
    weights: Float
    away: Float

    @classmethod
    def of(cls, fine: SurfaceBasis, count: int) -> Cage:
        """Of about `count` vertices."""
        vertices, triangles = decimated(fine.vertices, fine.triangles, count)
        below, shares = nearest_points(vertices, fine.vertices, fine.triangles)
        states = np.einsum("ck,sckd->scd", shares, fine.states[:, below])
        fixed = (fine.fixed[below] | (shares == 0)).all(axis=1)
        basis = SurfaceBasis(vertices, triangles, states, fixed)
        corners, weights = nearest_points(fine.vertices, vertices, triangles)
        return cls(basis, corners, weights, fine.vertices[:, None] - vertices[corners])

    def surface(self, x: Float, rotations: Float) -> Float:
        """Fine vertices (v, 3) mm, of the cage's (c, 3) and their rotations (c, 9)."""
        out = np.empty((len(self.corners), 3))
        _carry(self.corners, self.weights, self.away, x, rotations, out)
        return out


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def _carry(
    corners: Int, weights: Float, away: Float, x: Float, rotations: Float, out: Float
) -> None:
    for v in range(len(corners)):
        s0, s1, s2 = 0.0, 0.0, 0.0
        for k in range(3):
            i, w = corners[v, k], weights[v, k]
            r = rotations[i]
            a0, a1, a2 = away[v, k, 0], away[v, k, 1], away[v, k, 2]
            s0 += w * (x[i, 0] + r[0] * a0 + r[1] * a1 + r[2] * a2)
            s1 += w * (x[i, 1] + r[3] * a0 + r[4] * a1 + r[5] * a2)
            s2 += w * (x[i, 2] + r[6] * a0 + r[7] * a1 + r[8] * a2)
        out[v, 0], out[v, 1], out[v, 2] = s0, s1, s2
