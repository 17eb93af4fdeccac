"""A surface from a grid of signed distances: what is left of one that cannot be meshed as it is.

Winding numbers (Barill et al. 2018) tell inside from outside also where a surface crosses itself
or has holes. Whatever is finer than the grid is lost, and gaps narrower than it are closed.
"""

from __future__ import annotations

import igl
import numpy as np

from ....core.errors import MeshingError
from ....core.mesh import Surface

#: The grid's step, in edges of the tets, and how many points it has at most.
_STEP, _MOST = 0.4, 1_500_000


def voxel_surface(surface: Surface, edge_length: float) -> Surface:
    """The largest closed piece of the surface at distance 0 on a grid, by marching cubes. Raises
    MeshingError where there is none."""
    low, high = surface.bounds
    step = _step(surface, edge_length)
    axes = [np.arange(a - 2 * step, b + 3 * step, step) for a, b in zip(low, high, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    inside = igl.fast_winding_number(
        surface.vertices, np.ascontiguousarray(surface.faces), points
    ) > 0.5  # fmt: skip
    squared = igl.point_mesh_squared_distance(
        points, surface.vertices, np.ascontiguousarray(surface.faces)
    )[0]
    signed = np.where(inside, -1.0, 1.0) * np.sqrt(np.asarray(squared))
    signed = np.where(np.abs(signed) < 0.05 * step, 0.05 * step, signed)  # no slivers
    vertices, faces, _ = igl.marching_cubes(signed, points, *(len(a) for a in axes), 0.0)
    if not len(faces):
        raise MeshingError(f"a grid of {step:.2g} mm holds nothing of the body", code="grid-empty")
    faces = np.asarray(faces, np.int64)
    piece = np.asarray(igl.facet_components(faces)[1])
    faces = faces[piece == np.bincount(piece).argmax()]
    made = Surface(np.asarray(vertices, float), faces).compact()[0]
    return made if made.volume > 0 else Surface(made.vertices, made.faces[:, ::-1].copy())


def grid_points(surface: Surface, edge_length: float) -> float:
    """About how many points that grid has."""
    return float(np.prod(np.ptp(surface.bounds, axis=0) / _step(surface, edge_length) + 4))


def _step(surface: Surface, edge_length: float) -> float:
    whole = float(np.prod(np.ptp(surface.bounds, axis=0)))
    return max(_STEP * edge_length, float(np.cbrt(whole / _MOST)))
