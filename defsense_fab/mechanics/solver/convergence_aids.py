"""Where the body goes when its handles turn: a tangent step about a rotated state.

A plain tangent step carries the surroundings of a turning handle along straight lines, which
swells and soon inverts elements. Here the handles' rotations are first spread over the body by
harmonic weights (as in Zayer et al. 2005, "Harmonic Guidance for Surface Deformation"), every
deformation gradient F is turned by its share, G = R F, and the energy is linearised about G. That
is one linear solve with the material's own tangent, exact for a rigid motion of the whole body.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl
from scipy.spatial.transform import Rotation

from ...core.arrays import Float
from ..elements.tet10 import QUADRATURE, QuadraticMesh
from ..loading.boundary_conditions import BoundaryConditions, State, rotation_matrix
from ..loading.reduction import Reduction

# Where a body is about to crease or snap: the few nodes that hold Newton's method up.
#
# Solved alone, with the rest of the body held, they cost next to nothing, and the whole goes on from
# there. This is nonlinear elimination (Lanzkron, Rose & Wilkes 1996, "An Analysis of Approximate
# Nonlinear Elimination"; Cai & Li 2011, "Inexact Newton Methods with Restricted Additive Schwarz
# Based Nonlinear Elimination").

#: Part of the largest residual that counts as large.
LARGE_RESIDUAL_FRACTION = 0.1
#: Largest part of the unknowns with a large residual, and of the free nodes in a patch.
MAX_LARGE_FRACTION, MAX_PATCH_FRACTION = 0.01, 0.1
RINGS = 2  # of tets about the nodes with a large residual


def find_stuck_patch(reduction: Reduction, gradient: Float) -> tuple[Float, Float] | None:
    """Nodes (n,) bool to solve for and active cells (m,) bool about them, for the reduced gradient
    (size,); None where the residual is spread over the body."""
    own = reduction.is_free  # moments of handles are no forces
    at = np.zeros((len(own), 3))
    at[own] = np.abs(gradient[reduction.dof[own, :3]])
    large = at > LARGE_RESIDUAL_FRACTION * at.max()
    if large.sum() > MAX_LARGE_FRACTION * reduction.size:
        return None
    chosen = large.any(axis=1)
    for _ in range(RINGS):
        chosen[reduction.active.cells[chosen[reduction.active.cells].any(axis=1)]] = True
    chosen &= own
    if not 0 < chosen.sum() < MAX_PATCH_FRACTION * own.sum():
        return None
    return chosen, chosen[reduction.active.cells].any(axis=1)


class HandleRotation:
    """Harmonic weights of the handles with a prescribed rotation, (h, m, 4) at the points."""

    def __init__(self, mesh: QuadraticMesh, conditions: BoundaryConditions) -> None:
        self._handles = [i for i, h in enumerate(conditions.handles) if len(h.free_axes) == 0]
        corners = mesh.cells[:, :4]
        count = len(mesh.nodes)
        values = np.zeros((count, len(self._handles)))
        held = np.zeros(count, bool)
        held[conditions.fixed] = True
        for k, i in enumerate(self._handles):
            nodes = conditions.handles[i].nodes
            values[nodes, k] = 1.0
            held[nodes] = True
        used = np.zeros(count, bool)
        used[corners] = True
        solve, given = np.flatnonzero(used & ~held), np.flatnonzero(used & held)
        if len(solve) and len(given) and self._handles:
            local = np.einsum("m,mai,mbi->mab", mesh.weight, mesh.bary_gradient, mesh.bary_gradient)
            at = np.repeat(corners, 4, axis=1).ravel(), np.tile(corners, 4).ravel()
            laplacian = sp.csr_matrix((local.ravel(), at), shape=(count, count))
            inner = laplacian[solve][:, solve].tocsc()
            right = -laplacian[solve][:, given] @ values[given]
            values[solve] = spl.splu(inner, permc_spec="MMD_AT_PLUS_A").solve(right)
        self._weights = np.einsum("mck,qc->kmq", values[corners], QUADRATURE)

    def rotate(self, F: Float, before: State, after: State) -> Float:
        """G (m, 4, 3, 3): F turned by each point's share of the handles' rotations."""
        vector = np.zeros((*F.shape[:2], 3))
        for k, i in enumerate(self._handles):
            turn = Rotation.from_matrix(after.rotations[i] @ before.rotations[i].T).as_rotvec()
            vector += self._weights[k][..., None] * turn
        return np.asarray(rotation_matrix(vector) @ F)
