"""Where a body is about to crease or snap: the few nodes that hold Newton's method up.

Solved alone, with the rest of the body held, they cost next to nothing, and the whole goes on from
there. This is nonlinear elimination (Lanzkron, Rose & Wilkes 1996, "An Analysis of Approximate
Nonlinear Elimination"; Cai & Li 2011, "Inexact Newton Methods with Restricted Additive Schwarz
Based Nonlinear Elimination").
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ..loading.reduction import Reduction

#: Part of the largest residual that counts as large.
LARGE = 0.1
#: Largest part of the unknowns with a large residual, and of the free nodes in a patch.
FEW, SMALL = 0.01, 0.1
RINGS = 2  # of tets about the nodes with a large residual


def stuck_patch(reduction: Reduction, gradient: Float) -> tuple[Float, Float] | None:
    """Nodes (n,) bool to solve for and active cells (m,) bool about them, for the reduced gradient
    (size,); None where the residual is spread over the body."""
    own = reduction.own  # moments of handles are no forces
    at = np.zeros((len(own), 3))
    at[own] = np.abs(gradient[reduction.dof[own, :3]])
    large = at > LARGE * at.max()
    if large.sum() > FEW * reduction.size:
        return None
    chosen = large.any(axis=1)
    for _ in range(RINGS):
        chosen[reduction.active.cells[chosen[reduction.active.cells].any(axis=1)]] = True
    chosen &= own
    if not 0 < chosen.sum() < SMALL * own.sum():
        return None
    return chosen, chosen[reduction.active.cells].any(axis=1)
