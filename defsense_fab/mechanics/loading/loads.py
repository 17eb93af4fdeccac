"""Compute loads as nodal forces: gravity, soft drags, pressure on the surface, and fibers.

Pressure follows the deformed surface.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...core.arrays import Float, Int
from ..elements.point_location import LocatedPoints, PointLocator
from ..elements.tet10 import QuadraticMesh, scatter_nodes, shape_functions
from .boundary_conditions import BoundaryConditions, Pressure
from .fibers import EmbeddedFibers

#: Weights of the nodal forces of a constant body force on a straight-sided quadratic tet.
_LUMP = np.array([-1 / 20] * 4 + [1 / 5] * 6)


class Loads:
    """The loads of one structure of boundary conditions on a mesh.

    Args:
        mesh: The mesh.
        conditions: Conditions whose drags, faces and fibers the loads act on; the amounts may
            change.

    Attributes:
        mesh: The mesh.
        fibers: The fibers in it, None if there are none.
    """

    def __init__(self, mesh: QuadraticMesh, conditions: BoundaryConditions) -> None:
        self.mesh = mesh
        self._unit = scatter_nodes(
            mesh, np.repeat((4 * mesh.weight[:, None] * _LUMP)[:, :, None], 3, axis=2)
        )
        if conditions.drags:
            points = np.array([d.at for d in conditions.drags])
            at: LocatedPoints = PointLocator(mesh).find(points)
            self._drag_nodes: Int = mesh.cells[at.cell]
            self._drag_weights: Float = shape_functions(at.bary)
        fibers = conditions.fibers
        self.fibers = EmbeddedFibers(mesh, fibers) if fibers and fibers.lines else None

    def _stretches(self, conditions: BoundaryConditions, u: Float) -> Float:
        """Return the vector (d, 3) mm from each drag's target to its point."""
        at = np.einsum("dn,dna->da", self._drag_weights, u[self._drag_nodes])
        return np.asarray(at - [d.by for d in conditions.drags])

    def energy(self, conditions: BoundaryConditions, u: Float, frozen: Float) -> float:
        """Return the potential energy of the loads and the fibers, N mm.

        Args:
            conditions: Amounts of the loads.
            u: Displacements (n, 3) mm.
            frozen: Nodal forces (n, 3) N of the pressures, which count as dead loads.
        """
        total = -float((self._unit * u).sum(axis=0) @ conditions.gravity)
        if conditions.drags:
            k = np.array([d.stiffness for d in conditions.drags])
            total += float(0.5 * (k[:, None] * self._stretches(conditions, u) ** 2).sum())
        if conditions.pressures:
            total -= float((frozen * u).sum())
        if self.fibers:
            total += self.fibers.energy(self.fibers.vectors(u))
        return total

    def drag_forces(self, conditions: BoundaryConditions, u: Float) -> Float:
        """Return the force (d, 3) N of each drag on the body."""
        if not conditions.drags:
            return np.zeros((0, 3))
        k = np.array([d.stiffness for d in conditions.drags])[:, None]
        return np.asarray(-k * self._stretches(conditions, u))

    def pressure(self, conditions: BoundaryConditions, u: Float) -> Float:
        """Return the nodal forces (n, 3) N of the pressures on the deformed faces."""
        out = np.zeros_like(u)
        for p in conditions.pressures:
            x = (self.mesh.nodes + u)[p.faces]
            a, b = (np.einsum("qn,tna->tqa", d, x) for d in (_BY_R, _BY_S))
            force = -p.value * np.einsum("q,qn,tqa->tna", _AREA, _FACE, np.cross(a, b))
            np.add.at(out, p.faces, force)
        return out

    def forces(
        self,
        conditions: BoundaryConditions,
        u: Float,
        pressure: Float,
        about: Float | None = None,
    ) -> Float:
        """Return the nodal forces (n, 3) N of all loads, and those of the fibers on the body.

        Args:
            conditions: Amounts of the loads.
            u: Displacements (n, 3) mm.
            pressure: Nodal forces (n, 3) N of the pressures, which are included.
            about: Vectors (p, 3, d) about which the fibers are linearized; by default they are not.
        """
        out = self._unit * conditions.gravity + pressure
        if conditions.drags:
            pull = self.drag_forces(conditions, u)
            np.add.at(out, self._drag_nodes, self._drag_weights[:, :, None] * pull[:, None])
        if self.fibers:
            now = self.fibers.vectors(u)
            if about is None:
                out -= self.fibers.forces(now)
            else:
                out -= self.fibers.linearized_forces(about, now)
        return np.asarray(out)

    def blocks(
        self,
        conditions: BoundaryConditions,
        u: Float,
        share: float = 0.0,
        about: Float | None = None,
    ) -> list[tuple[Int, Float]]:
        """Return the symmetric blocks that the loads and fibers add to the tangent.

        Args:
            conditions: Amounts of the loads.
            u: Displacements (n, 3) mm.
            share: Share (0 to 1) of the negative part of the fibers' tangent that is removed.
            about: Vectors (p, 3, d) about which the fibers are linearized; by default those of u.

        Returns:
            Pairs of node numbers (..., k) and blocks (..., 3 k, 3 k) N/mm. Of the pressure, whose
            tangent is not symmetric, the block holds the symmetric part.
        """
        out: list[tuple[Int, Float]] = []
        for d, nodes, w in zip(
            conditions.drags,
            self._drag_nodes if conditions.drags else (),
            self._drag_weights if conditions.drags else (),
            strict=True,
        ):
            block = np.kron(d.stiffness * np.outer(w, w), np.eye(3))
            out.append((nodes, np.asarray(block, float)))
        for p in conditions.pressures:
            if p.value == 0:
                continue
            block = self._follower(p, u)
            out += list(zip(p.faces, 0.5 * (block + block.transpose(0, 2, 1)), strict=True))
        if self.fibers:
            vectors = self.fibers.vectors(u) if about is None else about
            out.append((self.fibers.nodes, self.fibers.tangents(vectors, share)))
        return out

    def skew(self, conditions: BoundaryConditions, u: Float) -> sp.csr_matrix | None:
        """Return the antisymmetric part (3 n, 3 n) N/mm of the tangent, or None without pressure.

        It differs from zero where pressure acts on an open surface: its work depends on the path.
        """
        parts = []
        for p in conditions.pressures:
            if p.value == 0:
                continue
            block = self._follower(p, u)
            dof = (3 * p.faces[:, :, None] + np.arange(3)).reshape(-1, 18)
            rows, columns = np.repeat(dof, 18, axis=1).ravel(), np.tile(dof, 18).ravel()
            values = 0.5 * (block - block.transpose(0, 2, 1)).ravel()
            parts.append(sp.csr_matrix((values, (rows, columns)), shape=(u.size, u.size)))
        return sum(parts[1:], parts[0]) if parts else None

    def _follower(self, p: Pressure, u: Float) -> Float:
        """Return the derivative (t, 18, 18) of minus the pressure's forces on its faces."""
        x = (self.mesh.nodes + u)[p.faces]
        a, b = (np.einsum("qn,tna->tqa", d, x) for d in (_BY_R, _BY_S))
        # d(a x b)/dx_m = skew(a) dN_m/ds - skew(b) dN_m/dr
        change = np.einsum("tqij,qm->tqimj", _skew(a), _BY_S) - np.einsum(
            "tqij,qm->tqimj", _skew(b), _BY_R
        )
        block = p.value * np.einsum("q,qn,tqimj->tnimj", _AREA, _FACE, change)
        return np.asarray(block.reshape(len(block), 18, 18))


def _skew(v: Float) -> Float:
    """Return the cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*v.shape, 3)


#: Six-point rule of degree 4 (Dunavant 1985), exact for these products: on a closed surface the
#: tangent is then symmetric. Shape functions of a face's six nodes and derivatives, (6, 6).
_P, _Q = 0.445948490915965, 0.091576213509771
_RS = np.array(
    [[_P, _P], [1 - 2 * _P, _P], [_P, 1 - 2 * _P], [_Q, _Q], [1 - 2 * _Q, _Q], [_Q, 1 - 2 * _Q]]
)
_AREA = np.array([0.223381589678011] * 3 + [0.109951743655322] * 3) / 2
_L = np.stack([1 - _RS.sum(1), _RS[:, 0], _RS[:, 1]], axis=1)
_FACE = np.stack(
    [*(x * (2 * x - 1) for x in _L.T)]
    + [4 * _L[:, i] * _L[:, j] for i, j in ((0, 1), (1, 2), (2, 0))],
    axis=1,
)


def _derivatives(by: Float) -> Float:
    """Return derivatives (6, 6) of a face's shape functions for coordinates that change by `by`."""
    corner = [(4 * _L[:, i] - 1) * by[i] for i in range(3)]
    edge = [4 * (_L[:, i] * by[j] + _L[:, j] * by[i]) for i, j in ((0, 1), (1, 2), (2, 0))]
    return np.stack(corner + edge, axis=1)


_BY_R = _derivatives(np.array([-1.0, 1.0, 0.0]))
_BY_S = _derivatives(np.array([-1.0, 0.0, 1.0]))
