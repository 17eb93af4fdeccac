"""Find directions of planes that are simple to print and join: those of a body's flat faces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.mesh import Surface

_MIN_AREA_FRACTION = 0.05  # of the surface, for a direction to count
_PARALLEL_TOLERANCE_RAD = 2e-3  # between parallel facets or planes
#: Facets of a flat face differ by rounding only: they lie in one cell of the grid of normals, or in
#: the cells that meet at a corner, at most this many.
_MAX_CELLS = 8
_MAX_OPEN_COSINE = 0.1  # of a face's normal along a direction that counts as open


def face_directions(surface: Surface) -> Float:
    """Return unit normals (k, 3) of planes that are simple to print and join.

    These are the normals of large flat faces, the largest first. Where they leave directions of
    space open, perpendicular directions follow, coordinate axes if possible.
    """
    flat = _flat_directions(surface)
    if not flat:
        return np.eye(3)
    sines = np.linalg.norm(np.cross(flat[0], flat), axis=1)
    if sines.max() < _MAX_OPEN_COSINE:
        axis = np.eye(3)[np.abs(flat[0]).argmin()]
        second = _unit(axis - (axis @ flat[0]) * flat[0])
        return np.stack([*flat, second, _unit(np.cross(flat[0], second))])
    third = _unit(np.cross(flat[0], flat[int(sines.argmax())]))
    return np.stack([*flat, third] if np.abs(flat @ third).max() < _MAX_OPEN_COSINE else flat)


def _unit(vector: Float) -> Float:
    return np.asarray(vector / np.linalg.norm(vector))


def _flat_directions(surface: Surface) -> list[Float]:
    """Return the normals of flat faces that are large enough, the largest first."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    normals, area = normals[area > 0] / area[area > 0, None], area[area > 0]
    # Facets in one cell of a grid of normals, of either sign, are merged, because scans have
    # 100,000 directions.
    outer = (normals[:, :, None] * normals[:, None]).reshape(-1, 9)
    _, first, cell = np.unique(
        np.rint(outer / _PARALLEL_TOLERANCE_RAD).astype(int),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    normals, area = normals[first], np.bincount(cell.ravel(), area)
    min_area, directions = _MIN_AREA_FRACTION * area.sum(), []
    for seed in np.argsort(-area, kind="stable"):
        if area[seed] < min_area / _MAX_CELLS:
            break
        is_parallel = _is_parallel(normals, normals[seed])
        total = float(area[is_parallel].sum())
        if total >= min_area:
            directions.append((total, normals[seed]))
        area[is_parallel] = 0.0
    directions.sort(key=lambda f: -f[0])
    return [n for _, n in directions]


def count_slanted(planes: Sequence[Plane], directions: Float) -> int:
    """Count the distinct directions of planes that are not among given ones (k, 3)."""
    distinct = list(directions)
    for plane in planes:
        if not _is_parallel(np.array(distinct), plane.normal).any():
            distinct.append(plane.normal)
    return len(distinct) - len(directions)


def _is_parallel(normals: Float, normal: Float) -> np.ndarray:
    """Return which of the unit normals (k, 3) are parallel to one, with either sign."""
    return np.asarray(np.linalg.norm(np.cross(normals, normal), axis=1) < _PARALLEL_TOLERANCE_RAD)
