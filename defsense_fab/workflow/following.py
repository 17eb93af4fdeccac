"""Where points on a body go when it deforms, and those a little outside of it, as what is glued on.

Fields are known inside the body alone: continued beyond it, their quadratic polynomials soon leave
everything that was simulated.
"""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float, format_point
from ..core.errors import DeviceError
from ..core.mesh import TetMesh
from ..geometry.kernels.surface_queries import SignedDistance
from ..mechanics.elements.point_location import PointLocator
from ..mechanics.elements.tet10 import QuadraticMesh
from ..runtime.surface.rotation import nearest_rotations

REACH = 0.1  # of the body's diagonal, by which points may be outside


def followed(mesh: TetMesh, points: Float, displacements: Float) -> Float:
    """Points (p, 3) mm of the rest frame in each state, (s, p, 3) mm, with the displacements
    (s, n, 3) mm of the quadratic mesh's nodes; outside of the body they are carried rigidly by the
    place of it that is nearest. Raises DeviceError for points further outside than REACH."""
    skin = SignedDistance(mesh.boundary())
    outside = np.flatnonzero(~skin.inside(points))
    on = points.copy()
    on[outside] = skin.nearest(points[outside])
    arms = points - on
    _refuse_far(points, np.linalg.norm(arms, axis=1), mesh)
    locator = PointLocator(QuadraticMesh.from_linear(mesh))
    moved = on + locator.displacement(locator.find(on), displacements)
    there = locator.find(on[outside])
    deformed = np.eye(3) + locator.gradient(there, displacements)
    turns = nearest_rotations(deformed.reshape(-1, 3, 3)).reshape(deformed.shape)
    moved[:, outside] += np.einsum("spij,pj->spi", turns, arms[outside])
    return np.asarray(moved)


def _refuse_far(points: Float, distance: Float, mesh: TetMesh) -> None:
    limit = REACH * float(np.linalg.norm(np.ptp(mesh.nodes, axis=0)))
    far = int((distance > limit).sum())
    if far:
        worst = int(distance.argmax())
        raise DeviceError(
            f"points: {far} of {len(points)} lie more than {limit:.3g} mm outside of the body, the"
            f" furthest {format_point(points[worst])} by {distance[worst]:.3g} mm, where nothing was"
            " simulated; give points in mm in the body's rest frame, on it or near it"
        )
