"""Simplify surfaces for a view on a screen."""

from __future__ import annotations

from collections.abc import Mapping

import igl
import numpy as np

from ...core.arrays import Int
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...geometry.kernels.triangle_kernel import to_manifold

_MAX_STATE_BYTES = 3_000_000  # of all states, before compression
_BYTES_PER_VERTEX = 13  # in a state: displacement, error and strain
#: Geometric tolerances of the parts, as shares of the device's size.
_MIN_TOLERANCE, _MAX_TOLERANCE = 1 / 4000, 1 / 250
_MAX_TRIANGLES = 60_000  # of all parts


def decimate_faces(surface: Surface, states: int) -> Int:
    """Reduce a surface whose fields are too large for a page, keeping vertices in place.

    Args:
        surface: The surface.
        states: Number of states in which each vertex has values.

    Returns:
        The surface's triangles (f, 3), or those of a subset of its vertices.
    """
    max_vertices = _MAX_STATE_BYTES // (_BYTES_PER_VERTEX * max(states, 1))
    if len(surface.vertices) <= max_vertices:
        return surface.faces
    decimated = igl.decimate(surface.vertices, surface.faces, 2 * (max_vertices - 2))
    a, b, c = corners = decimated[3][decimated[1]].T
    is_triangle = (a != b) & (b != c) & (a != c)  # two corners may stem from one vertex
    return np.asarray(corners.T[is_triangle], np.int64)


def simplify_parts(parts: Mapping[str, Surface], size: float) -> dict[str, Surface]:
    """Simplify parts within a tolerance.

    The tolerance is a four-thousandth of the device's size; it grows only if the parts have more
    triangles than a browser can turn smoothly. A part that is not closed is not simplified.

    Args:
        parts: Surfaces of the parts, by name.
        size: Diagonal of the device, mm.

    Returns:
        The simplified surfaces, by name.
    """
    solids = {}
    for name, surface in parts.items():
        try:
            solids[name] = to_manifold(surface, name)
        except FabricationError:
            solids[name] = None
    tolerance = _MIN_TOLERANCE * size
    while True:
        solids = {n: s and s.simplify(tolerance) for n, s in solids.items()}
        total = sum(s.num_tri() if s else len(parts[n].faces) for n, s in solids.items())
        tolerance *= 2
        if total <= _MAX_TRIANGLES or tolerance > _MAX_TOLERANCE * size:
            break
    return {n: reorder_vertices(_surface(s) if s else parts[n]) for n, s in solids.items()}


def _surface(solid: object) -> Surface:
    mesh = solid.to_mesh64()  # type: ignore[attr-defined]
    return Surface(np.array(mesh.vert_properties, float)[:, :3], np.array(mesh.tri_verts, np.int64))


def reorder_vertices(surface: Surface) -> Surface:
    """Renumber vertices in the order in which triangles use them, which compresses better."""
    order = vertex_order(surface.faces)
    number = np.empty(len(surface.vertices), np.int64)
    number[order] = np.arange(len(order))
    return Surface(surface.vertices[order], number[surface.faces])


def vertex_order(faces: Int) -> Int:
    """Return vertices (v,) in the order in which faces (f, 3) use them; all must have a face."""
    vertices, first_use = np.unique(faces, return_index=True)
    return np.asarray(vertices[np.argsort(first_use)])
