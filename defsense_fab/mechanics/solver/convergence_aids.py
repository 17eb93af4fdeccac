"""Help Newton's method to converge: predict turning handles, and solve stuck patches alone."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl
from scipy.spatial.transform import Rotation

from ...core.arrays import Float, Int
from ...core.rotations import rotation_matrices
from ..elements.tet10 import QUADRATURE, QuadraticMesh
from ..loading.boundary_conditions import BoundaryConditions, State
from ..loading.reduction import Reduction

LARGE_RESIDUAL_FRACTION = 0.1  # of the largest residual, from which one counts as large
MAX_LARGE_FRACTION = 0.01  # of the unknowns that may have a large residual
MAX_PATCH_FRACTION = 0.1  # of the free nodes that a patch may hold
PATCH_RINGS = 2  # rings of tets around the nodes with a large residual


def find_stuck_patch(reduction: Reduction, gradient: Float) -> tuple[Float, Float] | None:
    """Find the few nodes that keep Newton's method from converging.

    Where a body is about to crease or snap, a few nodes carry the residual. Solved alone, with the
    rest of the body held, they cost almost nothing, and the whole body converges from there.

    Args:
        reduction: The unknowns of the body.
        gradient: Reduced gradient (size,).

    Returns:
        Nodes (n,) bool of the patch and the active cells (m,) bool around them; None if the
        residual is spread over the body.

    References:
        Nonlinear elimination: Lanzkron, Rose & Wilkes 1996, "An Analysis of Approximate Nonlinear
        Elimination"; Cai & Li 2011, "Inexact Newton Methods with Restricted Additive Schwarz Based
        Nonlinear Elimination".
    """
    is_free = reduction.is_free  # moments of handles are not forces
    residual = np.zeros((len(is_free), 3))
    residual[is_free] = np.abs(gradient[reduction.dof[is_free, :3]])
    is_large = residual > LARGE_RESIDUAL_FRACTION * residual.max()
    if is_large.sum() > MAX_LARGE_FRACTION * reduction.size:
        return None
    in_patch = is_large.any(axis=1)
    for _ in range(PATCH_RINGS):
        in_patch[reduction.active.cells[in_patch[reduction.active.cells].any(axis=1)]] = True
    in_patch &= is_free
    if not 0 < in_patch.sum() < MAX_PATCH_FRACTION * is_free.sum():
        return None
    return in_patch, in_patch[reduction.active.cells].any(axis=1)


class HandleRotation:
    """Spreads the rotations of handles over the body, as the start of a tangent step.

    A plain tangent step carries the surroundings of a turning handle along straight lines, which
    swells and soon inverts elements. Instead, harmonic weights spread the handles' rotations over
    the body, every deformation gradient F is turned by its share, G = R F, and the energy is
    linearized about G. This takes one linear solve with the material's tangent and is exact for a
    rigid motion of the whole body.

    Args:
        mesh: The active mesh.
        conditions: Conditions whose handles with a prescribed rotation are spread.

    References:
        Zayer et al. 2005, "Harmonic Guidance for Surface Deformation".
    """

    def __init__(self, mesh: QuadraticMesh, conditions: BoundaryConditions) -> None:
        self._handles = [i for i, h in enumerate(conditions.handles) if len(h.free_axes) == 0]
        corners = mesh.cells[:, :4]
        count = len(mesh.nodes)
        values = np.zeros((count, len(self._handles)))
        is_held = np.zeros(count, bool)
        is_held[conditions.fixed] = True
        for k, i in enumerate(self._handles):
            nodes = conditions.handles[i].nodes
            values[nodes, k] = 1.0
            is_held[nodes] = True
        is_corner = np.zeros(count, bool)
        is_corner[corners] = True
        unknown, prescribed = (
            np.flatnonzero(is_corner & ~is_held),
            np.flatnonzero(is_corner & is_held),
        )
        if len(unknown) and len(prescribed) and self._handles:
            local = np.einsum("m,mai,mbi->mab", mesh.weight, mesh.bary_gradient, mesh.bary_gradient)
            indices = np.repeat(corners, 4, axis=1).ravel(), np.tile(corners, 4).ravel()
            laplacian = sp.csr_matrix((local.ravel(), indices), shape=(count, count))
            inner = laplacian[unknown][:, unknown].tocsc()
            right = -laplacian[unknown][:, prescribed] @ values[prescribed]
            values[unknown] = spl.splu(inner, permc_spec="MMD_AT_PLUS_A").solve(right)
        self._values = values
        self._weights = np.einsum("mck,qc->kmq", values[corners], QUADRATURE)

    def rotate(self, F: Float, before: State, after: State) -> Float:
        """Turn gradients by each point's share of the handles' rotations.

        Args:
            F: Deformation gradients (m, 4, 3, 3) at the state `before`.
            before: The state to start from.
            after: The state with its handles in place.

        Returns:
            The turned gradients G (m, 4, 3, 3).
        """
        vector = np.einsum("kmq,ka->mqa", self._weights, self._turns(before, after))
        return np.asarray(rotation_matrices(vector) @ F)

    def rotations(self, before: State, after: State, corners: Int, bary: Float) -> Float:
        """Return the rotations (p, 3, 3) by points' shares of the handles' rotations.

        Args:
            before: The state to start from.
            after: The state with its handles in place.
            corners: (p, 4) corner nodes of the points' tets.
            bary: (p, 4) barycentric coordinates of the points.
        """
        weights = np.einsum("pck,pc->pk", self._values[corners], bary)
        return rotation_matrices(weights @ self._turns(before, after))

    def _turns(self, before: State, after: State) -> Float:
        """Return the rotation vectors (k, 3) of the handles between two states."""
        turns = [
            Rotation.from_matrix(after.rotations[i] @ before.rotations[i].T).as_rotvec()
            for i in self._handles
        ]
        return np.reshape(turns, (-1, 3))
