"""Surfaces as light as a view on a screen needs them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...core.arrays import Int
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...geometry.kernels.triangle_kernel import to_manifold

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
