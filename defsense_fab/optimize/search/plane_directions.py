"""Directions of planes that are simple to print and to join: those of a body's flat faces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.mesh import Surface

#: Faces of one direction count from this share of the surface on.
_SHARE = 0.05
#: Facets and planes up to this far apart are parallel, radians.
_PARALLEL = 2e-3


def face_directions(surface: Surface) -> Float:
    """Unit normals (k, 3) of the directions that much of a body's surface is flat in, the largest
    first; of a body without flat faces the axes of the coordinates that it was drawn in."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    normals, area = normals[area > 0] / area[area > 0, None], area[area > 0]
    least, found = _SHARE * area.sum(), []
    while area.sum() >= least:
        normal = normals[area.argmax()]
        same = _parallel(normals, normal)
        if area[same].sum() >= least:
            found.append((float(area[same].sum()), normal))
        normals, area = normals[~same], area[~same]
    found.sort(key=lambda f: -f[0])
    return np.stack([n for _, n in found]) if found else np.eye(3)


def slanted(planes: Sequence[Plane], directions: Float) -> int:
    """How many directions the planes have besides the given ones (k, 3)."""
    known = list(directions)
    for plane in planes:
        if not _parallel(np.array(known), plane.normal).any():
            known.append(plane.normal)
    return len(known) - len(directions)


def _parallel(normals: Float, normal: Float) -> np.ndarray:
    """Which of the unit normals (k, 3) are parallel to one, either way round."""
    return np.asarray(np.linalg.norm(np.cross(normals, normal), axis=1) < _PARALLEL)
