"""The triangle kernel (manifold3d): carve and split bodies that are meshes, check CAD ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float
from ...core.errors import FabricationError
from ...core.mesh import Surface
from .cutting_tools import Frustum, Tool, frame
from .surface_queries import SurfaceCache

#: Facets around a round tool: its radius is that of the circle of the same area.
SIDES = 48
#: Half of what is left between the mating faces of two parts, mm: above the rounding of coordinates
#: in single precision, far below what any printer resolves.
GAP = 5e-5
_FLAT = 1e-6  # mm


def _manifold(surface: Surface) -> Any:
    return m3.Manifold(
        m3.Mesh64(
            np.ascontiguousarray(surface.vertices, np.float64),
            np.ascontiguousarray(surface.faces, np.uint64),
        )
    )


#: Many layouts are cut out of one body, and finished parts are looked at again and again.
_manifold_of = SurfaceCache(_manifold)


def to_manifold(surface: Surface, what: str) -> Any:
    """A manifold3d solid. Raises FabricationError where the surface is not closed and outward."""
    solid = _manifold_of(surface)
    if solid.status() != m3.Error.NoError:
        raise FabricationError(
            f"{what}: not a closed manifold ({solid.status().name})", code="surface-not-closed"
        )
    if solid.volume() <= 0:
        raise FabricationError(f"{what}: encloses no positive volume", code="encloses-no-volume")
    return solid


def printable(solid: Any, what: str, mating: Sequence[tuple[Float, float]] = ()) -> Surface:
    """A solid's facets as an STL file can hold them: in single precision, where no two vertices
    coincide that were apart, so that whoever reads the file finds the same edges again.

    Faces in the `mating` planes (outward normal (3,), offset mm) are set back by `GAP`, or by what
    coordinates are rounded by far from the origin: as rounded,
    those of two parts would pass through each other, which booleans of whoever checks them may
    take for an overlap of any size.

    Raises FabricationError where the result is not closed, or not in one piece.
    """
    mesh = solid.to_mesh64()
    exact = np.array(mesh.vert_properties, float)[:, :3]
    faces = np.array(mesh.tri_verts, np.int64)
    rounding = float(np.spacing(np.float32(np.abs(exact).max())))
    for normal, offset in mating:
        exact[np.abs(exact @ normal - offset) < _FLAT] -= max(GAP, rounding) * normal
    step = 16 * rounding
    rng = np.random.default_rng(0)
    vertices = exact.astype(np.float32)
    for _ in range(50):
        order = np.lexsort(vertices.T[::-1])
        alike = (vertices[order[1:]] == vertices[order[:-1]]).all(axis=1)
        again = np.sort(order[1:][alike])
        if not len(again):
            break
        moved = exact[again] + rng.uniform(-step, step, (len(again), 3))
        vertices[again] = moved.astype(np.float32)
    surface = Surface(vertices.astype(float), faces)
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges = ends.min(axis=1) * len(vertices) + ends.max(axis=1)
    if (np.unique(edges, return_counts=True)[1] != 2).any():
        raise FabricationError(
            f"{what}: an edge of its facets does not have two of them", code="surface-not-closed"
        )
    if len(to_manifold(surface, what).decompose()) != 1:
        raise FabricationError(f"{what}: is not in one piece", code="not-one-piece")
    return surface


def solid_of(tool: Tool) -> Any:
    """A tool's manifold3d solid."""
    if isinstance(tool, Frustum):
        along = tool.end - tool.start
        height = float(np.linalg.norm(along))
        wide = _same_area(SIDES)
        low, high = (wide * r for r in tool.radii)
        made = m3.Manifold.cylinder(height, low, high, SIDES)
        axes, origin = frame(along / height), tool.start
    else:
        made = m3.Manifold.extrude(m3.CrossSection([tool.polygon]), tool.height)
        axes, origin = tool.axes, tool.origin
    return made.transform(np.column_stack([axes, origin]))


def without(solid: Any, tools: Sequence[Tool]) -> Any:
    """The solid with tools cut out of it."""
    return solid - union([solid_of(t) for t in tools]) if tools else solid


def _same_area(sides: int) -> float:
    """Circumradius of the polygon that has the area of the unit circle."""
    return float(np.sqrt(2 * np.pi / (sides * np.sin(2 * np.pi / sides))))


def tube(points: Float, normal: Float, diameter: float, sides: int = SIDES) -> Any:
    """Tube along a planar polyline (n, 3) whose plane has `normal`, of the round tube's area."""
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(normal, tangent)
    angle = np.arange(sides) * 2 * np.pi / sides
    radius = diameter / 2 * _same_area(sides)
    ring = np.cos(angle)[:, None] * normal + np.sin(angle)[:, None] * side[:, None, :]
    vertices = (points[:, None] + radius * ring).reshape(-1, 3)
    n = len(points)
    i, j = np.meshgrid(np.arange(n - 1), np.arange(sides), indexing="ij")
    k = (j + 1) % sides
    a, b, c, d = i * sides + j, i * sides + k, (i + 1) * sides + k, (i + 1) * sides + j
    walls = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    fan = np.arange(1, sides - 1)
    start = np.stack([np.zeros_like(fan), fan + 1, fan], 1)
    end = np.stack([np.zeros_like(fan), fan, fan + 1], 1) + (n - 1) * sides
    faces = np.concatenate([walls, start, end])
    surface = Surface(vertices, faces)
    if surface.volume < 0:
        surface = Surface(vertices, faces[:, ::-1])
    return to_manifold(surface, "channel")


def union(solids: Sequence[Any]) -> Any:
    """All solids in one manifold."""
    return m3.Manifold.batch_boolean(list(solids), m3.OpType.Add)


def to_surface(solid: Any) -> Surface:
    """The facets of a manifold, mm."""
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties, float)[:, :3]
    return Surface(vertices, np.array(mesh.tri_verts, np.int64))


def centroid(surface: Surface) -> Float:
    """Centre of mass (3,) mm: each facet and the origin span a tetrahedron."""
    corners = surface.vertices[surface.faces]
    volume = np.linalg.det(corners)
    return np.asarray(volume @ corners.sum(1) / (4 * volume.sum()))
