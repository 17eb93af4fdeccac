"""What small forces do to a body at rest, by its tangent there."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ..elements import tet10
from ..elements.material import Material
from ..elements.point_location import PointLocator
from ..elements.tet10 import QuadraticMesh, shape
from ..loading.boundary_conditions import BoundaryConditions, rest
from ..loading.reduction import Reduction
from .linear_solver import make_solver


def displaced(mesh: QuadraticMesh, material: Material, fixed: Int, forces: Float) -> Float:
    """Displacements (n, 3) mm under nodal `forces` (n, 3) N with the nodes `fixed` (k,) held, to
    first order: they are too large where the body stiffens as it is bent or drawn."""
    conditions = BoundaryConditions(fixed)
    reduction = Reduction(mesh, conditions)
    state = rest(conditions, len(mesh.nodes))
    F = tet10.deformation_gradient(reduction.active, state.u)
    solver = make_solver()
    try:
        solver.factor(reduction.matrix(state, material, F, 0.0, []))
        return reduction.linear(state, solver.solve(reduction.gradient(state, forces)))
    finally:
        solver.close()


def line_forces(locator: PointLocator, path: Float, tension: float) -> Float:
    """Nodal forces (n, 3) N of a line along a `path` (p, 3) mm that slides and is under `tension`
    N: it pulls at its ends, and presses where it bends."""
    piece = np.diff(path, axis=0)
    pull = tension * piece / np.linalg.norm(piece, axis=1)[:, None]
    at = locator.find(path)
    spread = shape(at.bary)[:, :, None] * np.diff(pull, axis=0, prepend=0, append=0)[:, None]
    out = np.zeros_like(locator.mesh.nodes)
    np.add.at(out, locator.mesh.cells[at.cell], spread)
    return out
