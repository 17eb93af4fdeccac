"""Make the data of the 3D view small: simplify surfaces, and pack arrays."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from typing import Any

import igl
import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...geometry.kernels.triangle_kernel import to_manifold

_ALIGNMENT_BYTES = 4  # at which a browser can place an array of any of these types
_TYPES: dict[str, type[np.integer[Any]]] = {
    "u1": np.uint8,
    "i2": np.int16,
    "u2": np.uint16,
    "u4": np.uint32,
}
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


class PackedArrays:
    """Arrays of integers in one text: deflated and base64-encoded.

    Attributes:
        index: Type, first byte and number of values of each array.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.index: list[tuple[str, int, int]] = []

    def add(self, numbers: Any, kind: str) -> int:
        """Add an array of integers.

        Args:
            numbers: Numbers; they are rounded, and clipped to the range of the type.
            kind: Type, one of "u1", "i2", "u2" and "u4" (little-endian).

        Returns:
            The array's index.
        """
        limits = np.iinfo(_TYPES[kind])
        clipped = np.clip(np.rint(np.asarray(numbers)), limits.min, limits.max)
        data = clipped.astype(np.dtype(_TYPES[kind]).newbyteorder("<"))
        self._bytes += bytes(-len(self._bytes) % _ALIGNMENT_BYTES)
        self.index.append((kind, len(self._bytes), data.size))
        self._bytes += data.tobytes()
        return len(self.index) - 1

    def lengths(self, mm: Float, step: float) -> int:
        """Add coordinates (..., 3) mm as multiples of `step` mm, axis by axis; return the index."""
        return self.add(np.moveaxis(np.asarray(mm), -1, 0) / step, "i2")

    def faces(self, faces: Int) -> int:
        """Add triangles (f, 3) as differences of consecutive vertex numbers; return the index.

        The differences are small in meshes whose triangles follow one another.
        """
        flat = np.asarray(faces, np.int64).ravel()
        steps = np.diff(flat, prepend=0)
        return self.add((steps << 1) ^ (steps >> 63), "u2" if np.ptp(flat) < 2**15 else "u4")

    def shares(self, values: Float, top: float) -> int:
        """Add values from 0 to `top` in 255 steps; return the index."""
        return self.add(255 * np.asarray(values) / max(top, 1e-12), "u1")

    def text(self) -> str:
        """Return all arrays as text; the same numbers give the same text."""
        return base64.b64encode(zlib.compress(bytes(self._bytes), 6)).decode("ascii")
