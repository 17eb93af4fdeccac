"""Cut triangle bodies with manifold3d: carve and split mesh bodies, and check CAD ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import FabricationError
from ...core.mesh import Surface, triangle_edges
from .cutting_tools import Frustum, Tool, axes_from_normal
from .surface_queries import SurfaceCache

#: Facets around a round tool, which has the area of the circle.
TUBE_SIDES = 36
TUBE_SAG_MM = 0.002  # between the chords of a tube and the polyline that it follows
#: Half of the gap between the mating faces of two parts: above the rounding of coordinates in
#: single precision, far below what any printer resolves.
MATING_GAP_MM = 5e-5
PLANE_TOLERANCE_MM = 1e-6  # mm
#: Corners that coincide after rounding are moved by at most this multiple of the rounding.
ROUNDINGS_MOVED = 16
MAX_SEPARATION_ROUNDS = 50  # of moving corners that coincide after rounding


def _manifold(surface: Surface) -> Any:
    return m3.Manifold(
        m3.Mesh64(
            np.ascontiguousarray(surface.vertices, np.float64),
            np.ascontiguousarray(surface.faces, np.uint64),
        )
    )


def try_manifold(surface: Surface) -> Any | None:
    """Return a surface as a manifold3d solid, or None if it is not closed and oriented."""
    solid = _manifold(surface)
    return solid if solid.status() == m3.Error.NoError else None


#: Many layouts are cut out of one body, and finished parts are checked repeatedly.
_cached_manifold = SurfaceCache(_manifold)


def to_manifold(surface: Surface, what: str) -> Any:
    """Return a surface as a manifold3d solid.

    Args:
        surface: Closed surface, mm.
        what: Name of the body or part for errors.

    Raises:
        FabricationError: If the surface is not closed and outward.
    """
    solid = _cached_manifold(surface)
    if solid.status() != m3.Error.NoError:
        raise FabricationError(
            f"is not a closed manifold ({solid.status().name})",
            code="surface-not-closed",
            where=what,
        )
    if solid.volume() <= 0:
        raise FabricationError("encloses no positive volume", code="encloses-no-volume", where=what)
    return solid


def round_to_single(vertices: Float) -> Float:
    """Return coordinates rounded to single precision, as an STL file holds them."""
    return vertices.astype(np.float32).astype(float)


def separate_corners(
    exact: Float, rounded: Callable[[Float], Float], step: float, what: str
) -> Float:
    """Return corners, moved where two of them would become one by rounding.

    Args:
        exact: Corners (n, 3) of a surface, mm.
        rounded: Function that rounds coordinates as the file does.
        step: Largest distance by which a coordinate is moved, mm.
        what: Name of the part for errors.

    Returns:
        The corners (n, 3), not rounded, mm.

    Raises:
        FabricationError: If two corners still coincide.
    """
    rng = np.random.default_rng(0)
    moved, places = exact.copy(), rounded(exact)
    for _ in range(MAX_SEPARATION_ROUNDS):
        order = np.lexsort(places.T[::-1])
        is_duplicate = (places[order[1:]] == places[order[:-1]]).all(axis=1)
        duplicates = np.sort(order[1:][is_duplicate])
        if not len(duplicates):
            return moved
        moved[duplicates] = exact[duplicates] + rng.uniform(-step, step, (len(duplicates), 3))
        places[duplicates] = rounded(moved[duplicates])
    raise FabricationError(
        f"{len(duplicates)} corners of its facets coincide after rounding",
        code="corners-coincide",
        where=what,
        action="Use a body with fewer facets",
    )


def to_printable_surface(
    solid: Any, what: str, mating: Sequence[tuple[Float, float]] = ()
) -> Surface:
    """Return a solid's facets as an STL file can hold them.

    Coordinates are in single precision, and no two vertices coincide that were apart, so that a
    program that reads the file finds the same edges again. Faces in `mating` planes are set back by
    `MATING_GAP_MM`, or by the rounding of coordinates far from the origin: otherwise the rounded
    faces of two parts would pass through each other, which boolean operations may report as an
    overlap of any size.

    Args:
        solid: The manifold3d solid.
        what: Name of the part for errors.
        mating: Planes as outward normal (3,) and offset, mm.

    Raises:
        FabricationError: If the result is not closed or not in one piece.
    """
    mesh = solid.to_mesh64()
    exact = np.array(mesh.vert_properties, float)[:, :3]
    faces = np.array(mesh.tri_verts, np.int64)
    rounding = float(np.spacing(np.float32(np.abs(exact).max())))
    for normal, offset in mating:
        exact[np.abs(exact @ normal - offset) < PLANE_TOLERANCE_MM] -= (
            max(MATING_GAP_MM, rounding) * normal
        )
    step = ROUNDINGS_MOVED * rounding
    corners = separate_corners(exact, round_to_single, step, what)
    surface = Surface(round_to_single(corners), faces)
    if (triangle_edges(faces)[1] != 2).any():
        raise FabricationError(
            "an edge of its facets does not have exactly two of them",
            code="surface-not-closed",
            where=what,
        )
    if len(to_manifold(surface, what).decompose()) != 1:
        raise FabricationError("is not in one piece", code="not-one-piece", where=what)
    return surface


def solid_of(tool: Tool) -> Any:
    """Return the manifold3d solid of a tool."""
    if isinstance(tool, Frustum):
        along = tool.end - tool.start
        height = float(np.linalg.norm(along))
        if height == 0:
            return m3.Manifold()  # it has no volume, and no direction
        widening = _equal_area_radius(TUBE_SIDES)
        low, high = (widening * r for r in tool.radii)
        solid = m3.Manifold.cylinder(height, low, high, TUBE_SIDES)
        axes, origin = axes_from_normal(along / height), tool.start
    else:
        solid = m3.Manifold.extrude(m3.CrossSection([tool.polygon]), tool.height)
        axes, origin = tool.axes, tool.origin
    return from_plane_frame(solid, axes, origin)


def cut_out(solid: Any, tools: Sequence[Tool]) -> Any:
    """Return the solid with tools cut out of it."""
    return solid - union([solid_of(t) for t in tools]) if tools else solid


def _equal_area_radius(sides: int) -> float:
    """Return the circumradius of the polygon with the area of the unit circle."""
    return float(np.sqrt(2 * np.pi / (sides * np.sin(2 * np.pi / sides))))


def tube(points: Float, normal: Float, diameter: float, sides: int = TUBE_SIDES) -> Any:
    """Return a tube along a planar polyline, with the cross-section area of the round tube.

    Corners are left out where the tube moves by less than `TUBE_SAG_MM`, because the time of later
    cuts grows with the number of facets.

    Args:
        points: Corners (n, 3) of the polyline, mm.
        normal: Unit normal (3,) of its plane.
        diameter: Diameter, mm.
        sides: Number of facets around.
    """
    kept = _corners(points, TUBE_SAG_MM)
    tangent = np.gradient(points, axis=0)[kept]
    points = points[kept]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(normal, tangent)
    angle = np.arange(sides) * 2 * np.pi / sides
    radius = diameter / 2 * _equal_area_radius(sides)
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


def _corners(points: Float, sag: float) -> Int:
    """Return the indices of the corners (n, 3) that keep a polyline within `sag` mm of all.

    References:
        Douglas & Peucker, Algorithms for the reduction of the number of points required to
        represent a digitized line or its caricature, Cartographica 10(2), 1973.
    """
    kept, spans = [0, len(points) - 1], [(0, len(points) - 1)]
    while spans:
        first, last = spans.pop()
        inner = points[first + 1 : last] - points[first]
        if not len(inner):
            continue
        chord = points[last] - points[first]
        along = np.clip(inner @ chord / max(chord @ chord, 1e-300), 0.0, 1.0)
        distance = np.linalg.norm(inner - along[:, None] * chord, axis=1)
        farthest = int(distance.argmax())
        if distance[farthest] > sag:
            middle = first + 1 + farthest
            kept.append(middle)
            spans += [(first, middle), (middle, last)]
    return np.sort(kept)


def union(solids: Sequence[Any]) -> Any:
    """Return the union of solids."""
    return m3.Manifold.batch_boolean(list(solids), m3.OpType.Add)


def to_surface(solid: Any) -> Surface:
    """Return the facets of a manifold3d solid, mm."""
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties, float)[:, :3]
    return Surface(vertices, np.array(mesh.tri_verts, np.int64))


@dataclass(frozen=True)
class ThinPlaces:
    """The places of a solid that are too thin to print.

    Attributes:
        share: Share of the area of all layers.
        point: Point (3,) of the largest thin place, mm, or None if there is none.
    """

    share: float
    point: Float | None


def find_thin_places(
    solid: Any, down: Float, width: float, layers: int, tolerance: float
) -> ThinPlaces:
    """Find where a solid is thinner than a width in its layers as it is printed.

    The area counts that is lost when the outline of a layer is opened by the width.

    Args:
        solid: The manifold3d solid.
        down: Direction (3,) to the bed.
        width: Least width, mm.
        layers: Number of layers.
        tolerance: By which outlines are widened so that their corners do not count, mm.
    """
    axes = axes_from_normal(-down)
    upright = to_plane_frame(solid, axes, np.zeros(3))
    low, high = upright.bounding_box()[2], upright.bounding_box()[5]
    total_area, thin_area, largest_area, point = 0.0, 0.0, 0.0, None
    for z in low + (np.arange(layers) + 0.5) / layers * (high - low):
        layer = upright.slice(float(z))
        total_area += float(layer.area())
        for shape in (layer - layer.offset(-width / 2).offset(width / 2 + tolerance)).decompose():
            area = float(shape.area())
            if area > width**2:  # larger than a corner
                thin_area += area
                if area > largest_area:
                    largest_area = area
                    point = axes @ np.array([*np.asarray(shape.to_polygons()[0]).mean(axis=0), z])
    return ThinPlaces(thin_area / total_area if total_area else 1.0, point)


#: Width of a film, mm.
FILM_MM = 1e-3


def find_film(solid: Any, down: Float, layers: int, allowed: float) -> Float | None:
    """Find walls without thickness, films, in the layers of a solid as it is printed.

    An outline that is opened by the width of a film loses the films, and length. Films between the
    layers or parallel to them are not found.

    Args:
        solid: The manifold3d solid.
        down: Direction (3,) to the bed.
        layers: Number of layers, spread over the height.
        allowed: Length of all films in a layer that is allowed, mm.

    Returns:
        The point (3,) of the lowest layer with more than the allowed length that is farthest from
        the rest of the layer, mm, or None if there is no such layer.
    """
    axes = axes_from_normal(-down)
    upright = to_plane_frame(solid, axes, np.zeros(3))
    low, high = upright.bounding_box()[2], upright.bounding_box()[5]
    for z in low + (np.arange(layers) + 0.5) / layers * (high - low):
        layer = upright.slice(float(z))
        opened = _open_outline(layer)
        if (_outline_length(layer) - _outline_length(opened)) / 2 > allowed:
            point: Float = axes @ np.array([*_find_farthest_point(layer, opened), z])
            return point
    return None


def _find_farthest_point(layer: Any, other: Any) -> Float:
    """Return the corner or middle (2,) of a line of a layer that is farthest from another, mm."""
    points = np.concatenate([x for a, b in _list_lines(layer) for x in (a, (a + b) / 2)])
    distances = np.full(len(points), np.inf)
    for starts, ends in _list_lines(other):
        for a, b in zip(starts, ends, strict=True):
            along = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0.0, 1.0)
            offsets = points - a - along[:, None] * (b - a)
            distances = np.minimum(distances, np.linalg.norm(offsets, axis=1))
    farthest: Float = points[distances.argmax()]
    return farthest


def _open_outline(layer: Any) -> Any:
    """Return a layer without its films."""
    join = m3.JoinType.Miter
    return layer.offset(-FILM_MM / 2, join, 2.0).offset(FILM_MM / 2, join, 2.0)


def _list_lines(layer: Any) -> list[tuple[Float, Float]]:
    """Return where the lines of each outline of a layer start and end (n, 2), mm."""
    outlines = [np.asarray(p, float) for p in layer.to_polygons()]
    return [(p, np.roll(p, -1, axis=0)) for p in outlines]


def _outline_length(layer: Any) -> float:
    """Return the length of all outlines of a layer, mm."""
    return float(sum(np.linalg.norm(b - a, axis=1).sum() for a, b in _list_lines(layer)))


def to_plane_frame(solid: Any, axes: Float, origin: Float) -> Any:
    """Return the solid in the frame with `axes` (3, 3) and `origin` (3,), mm."""
    return solid.transform(np.column_stack([axes.T, -axes.T @ origin]))


def from_plane_frame(solid: Any, axes: Float, origin: Float) -> Any:
    """Return the solid of a frame in the rest frame: the inverse of `to_plane_frame`."""
    return solid.transform(np.column_stack([axes, origin]))
