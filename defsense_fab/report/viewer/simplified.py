"""Surfaces as light as a view on a screen needs them."""

from __future__ import annotations

from collections.abc import Mapping

import igl
import numpy as np

from ...core.arrays import Int
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...geometry.kernels.triangle_kernel import to_manifold

# Fewer triangles of a surface whose vertices stay where they are, so that fields still fit.

_BYTES = 3_000_000  # of all states, before they are deflated
_EACH = 13  # bytes of a vertex in a state: where it is, how far off it is read, its strain


def light_faces(surface: Surface, states: int) -> Int:
    """The surface's triangles (f, 3), or, where its vertices in so many states were too many for a
    page, those of some of its vertices."""
    room = _BYTES // (_EACH * max(states, 1))
    if len(surface.vertices) <= room:
        return surface.faces
    made = igl.decimate(surface.vertices, surface.faces, 2 * (room - 2))
    a, b, c = corners = made[3][made[1]].T
    apart = (a != b) & (b != c) & (a != c)  # two corners may be born of one vertex
    return np.asarray(corners.T[apart], np.int64)


#: Of the device's size: what may be lost of its shape, at first and at most.
_FINEST, _COARSEST = 1 / 4000, 1 / 250
_TRIANGLES = 60_000  # of all parts


def simplified(parts: Mapping[str, Surface], size: float) -> dict[str, Surface]:
    """Parts within a four-thousandth of the device's `size` (mm) of what they are; further off only
    where they have more triangles than a browser turns with ease. A part that is not closed stays
    as it is."""
    solids = {}
    for name, surface in parts.items():
        try:
            solids[name] = to_manifold(surface, name)
        except FabricationError:
            solids[name] = None
    tolerance = _FINEST * size
    while True:
        solids = {n: s and s.simplify(tolerance) for n, s in solids.items()}
        total = sum(s.num_tri() if s else len(parts[n].faces) for n, s in solids.items())
        tolerance *= 2
        if total <= _TRIANGLES or tolerance > _COARSEST * size:
            break
    return {n: in_order(_surface(s) if s else parts[n]) for n, s in solids.items()}


def _surface(solid: object) -> Surface:
    mesh = solid.to_mesh64()  # type: ignore[attr-defined]
    return Surface(np.array(mesh.vert_properties, float)[:, :3], np.array(mesh.tri_verts, np.int64))


def in_order(surface: Surface) -> Surface:
    """The same surface, its vertices numbered as its triangles come to them: it packs better."""
    order = order_of(surface.faces)
    number = np.empty(len(surface.vertices), np.int64)
    number[order] = np.arange(len(order))
    return Surface(surface.vertices[order], number[surface.faces])


def order_of(faces: Int) -> Int:
    """Vertices (v,) in the order in which faces (f, 3) come to them; all must have a face."""
    seen, first = np.unique(faces, return_index=True)
    return np.asarray(seen[np.argsort(first)])
