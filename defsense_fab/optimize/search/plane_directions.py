"""Directions of planes that are simple to print and to join: those of a body's flat faces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.mesh import Surface

#: Faces of one direction count from this share of the surface on.
_MIN_AREA_FRACTION = 0.05
#: Facets and planes up to this far apart are parallel, radians.
_PARALLEL_TOLERANCE_RAD = 2e-3
#: A flat face's facets differ by rounding alone: they lie in one cell of the grid, or where up to
#: so many meet.
_MAX_CELLS = 8
#: A direction is open where no face's normal has more than this share in it.
_MAX_OPEN_COSINE = 0.1


def face_directions(surface: Surface) -> Float:
    """Unit normals (k, 3) of planes that are simple: the directions that much of a body's surface
    is flat in, the largest first, and ones square to these where they leave directions of space
    open: axes of the coordinates that the body was drawn in, if they are square to them."""
    found = _flat_directions(surface)
    if not found:
        return np.eye(3)
    apart = np.linalg.norm(np.cross(found[0], found), axis=1)
    if apart.max() < _MAX_OPEN_COSINE:
        axis = np.eye(3)[np.abs(found[0]).argmin()]
        second = _unit(axis - (axis @ found[0]) * found[0])
        return np.stack([*found, second, _unit(np.cross(found[0], second))])
    third = _unit(np.cross(found[0], found[int(apart.argmax())]))
    return np.stack([*found, third] if np.abs(found @ third).max() < _MAX_OPEN_COSINE else found)


def _unit(vector: Float) -> Float:
    return np.asarray(vector / np.linalg.norm(vector))


def _flat_directions(surface: Surface) -> list[Float]:
    """The directions that enough of the surface is flat in."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    normals, area = normals[area > 0] / area[area > 0, None], area[area > 0]
    # Facets of one cell of a grid are alike, whichever way round; scans have 100,000 directions.
    outer = (normals[:, :, None] * normals[:, None]).reshape(-1, 9)
    _, first, cell = np.unique(
        np.rint(outer / _PARALLEL_TOLERANCE_RAD).astype(int),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    normals, area = normals[first], np.bincount(cell.ravel(), area)
    least, found = _MIN_AREA_FRACTION * area.sum(), []
    for seed in np.argsort(-area, kind="stable"):
        if area[seed] < least / _MAX_CELLS:
            break
        same = _is_parallel(normals, normals[seed])
        total = float(area[same].sum())
        if total >= least:
            found.append((total, normals[seed]))
        area[same] = 0.0
    found.sort(key=lambda f: -f[0])
    return [n for _, n in found]


def count_slanted(planes: Sequence[Plane], directions: Float) -> int:
    """How many directions the planes have besides the given ones (k, 3)."""
    known = list(directions)
    for plane in planes:
        if not _is_parallel(np.array(known), plane.normal).any():
            known.append(plane.normal)
    return len(known) - len(directions)


def _is_parallel(normals: Float, normal: Float) -> np.ndarray:
    """Which of the unit normals (k, 3) are parallel to one, either way round."""
    return np.asarray(np.linalg.norm(np.cross(normals, normal), axis=1) < _PARALLEL_TOLERANCE_RAD)
