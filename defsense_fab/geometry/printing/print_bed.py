"""Arrange parts on a printer's bed: cut face down, turned to take little room, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import axes_from_normal
from .overhangs import measure_overhang
from .packing import count_least_plates, pack

#: Least area of a first layer that holds a part on the bed.
MIN_FIRST_LAYER_MM2 = 20.0
LAYER_HEIGHT_MM = 0.15  # of the first layer
LINE_WIDTH_MM = 0.4
MAX_SIDES = 40  # of the hull of a part
#: A part that needs supports lies on another side if that takes at most these shares of the height
#: and of the volume below its overhangs.
MAX_LOWER_SIDE_SHARE, MAX_SUPPORT_SHARE = 0.9, 0.25


@dataclass(frozen=True)
class PlacedPart:
    """A part on a plate.

    Attributes:
        plate: The plate, counted from 0.
        surface: The surface, moved and turned, in mm from the plate's front left corner.
    """

    plate: int
    surface: Surface


def choose_side_down(surface: Surface, preferred: Sequence[Float], bare: Any = None) -> Float:
    """Return the direction (3,) that points down as a part is printed.

    It is the first of the preferred ones with a sufficient first layer. If there is none, it is the
    one with the largest first layer among these, the sides of the convex hull and the main axes. If
    the part needs supports on that side, and lies lower on another one with a sufficient first
    layer and much less support, it is that one.

    Args:
        surface: Surface of the part.
        preferred: Preferred directions (3,).
        bare: The part without grooves and sockets (manifold3d solid), if it has any.
    """
    solid = triangle_kernel.to_manifold(surface, "a part")
    for down in preferred:
        if first_layer_area(solid, down) >= MIN_FIRST_LAYER_MM2:
            break
    else:
        sides = [*preferred, *_find_sides(surface)]
        down = max(sides, key=lambda normal: first_layer_area(solid, normal))
    return _find_lower_side(surface, solid, solid if bare is None else bare, down)


def _find_lower_side(surface: Surface, solid: Any, bare: Any, down: Float) -> Float:
    """Return the side on which a part lies lower with much less support than on a given one, or
    that one.

    Args:
        surface: Surface of the part.
        solid: The same as a manifold3d solid.
        bare: The part without grooves and sockets.
        down: Direction (3,) that points down on the given side.
    """
    least = MAX_SUPPORT_SHARE * measure_overhang(bare, down).volume
    if not least:
        return down
    max_height = MAX_LOWER_SIDE_SHARE * np.ptp(surface.vertices @ down)
    heights = [(float(np.ptp(surface.vertices @ n)), n) for n in _find_sides(surface)]
    lower = [(h, n) for h, n in heights if h <= max_height]
    for _, normal in sorted(lower, key=lambda side: round(side[0], 3)):
        if first_layer_area(solid, normal) >= MIN_FIRST_LAYER_MM2:
            volume = measure_overhang(bare, normal).volume
            if volume < least:
                down, least = normal, volume
            if not volume:
                break
    return down


def find_other_side(surface: Surface, bed: tuple[float, float, float]) -> Float | None:
    """Return the direction (3,) that points down on another side that the bed holds, or None.

    Args:
        surface: Surface of the part.
        bed: Size of the bed, mm.

    Returns:
        Of the sides on which the bed holds the part, the one with the largest first layer.
    """
    solid = triangle_kernel.to_manifold(surface, "a part")
    fitting_sides = [
        normal for normal in _find_sides(surface) if fits_bed(lay_flat(surface, normal), bed)
    ]
    return max(fitting_sides, key=lambda normal: first_layer_area(solid, normal), default=None)


def _find_sides(surface: Surface) -> list[Float]:
    """Return directions (3,) to lie on: the largest sides of the convex hull, and the main axes."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(surface.vertices)
    a, b, c = (hull.points[hull.simplices[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    exact = hull.equations[:, :3]
    _, side_of_facet = np.unique(np.round(exact, 2), axis=0, return_inverse=True)
    areas = np.round(np.bincount(side_of_facet.reshape(-1), area), 6)
    largest = np.argsort(-areas, kind="stable")[:MAX_SIDES]
    main_axes = np.linalg.svd(hull.points - hull.points.mean(0), full_matrices=False)[2]
    normals = np.zeros((len(areas), 3))
    np.add.at(normals, side_of_facet.reshape(-1), area[:, None] * exact)
    flats = normals[largest] / np.linalg.norm(normals[largest], axis=1)[:, None]
    return [*flats, *main_axes, *-main_axes]


def first_layer_area(solid: Any, down: Float) -> float:
    """Return the area of a part's first layer (manifold3d solid) that two lines of the printer
    fill, mm^2.
    """
    upright = solid.transform(np.column_stack([axes_from_normal(-down).T, np.zeros(3)]))
    layer = upright.slice(upright.bounding_box()[2] + LAYER_HEIGHT_MM)
    return float(layer.offset(-LINE_WIDTH_MM).offset(LINE_WIDTH_MM).area())


def lay_flat(surface: Surface, down: Float) -> Surface:
    """Lay a surface down as it is printed.

    Args:
        surface: Surface of the part.
        down: Direction (3,) that points down.

    Returns:
        The surface on z = 0, centered at x = y = 0, turned about the vertical so that the rectangle
        around it is smallest.
    """
    vertices = surface.vertices @ axes_from_normal(-down)
    from scipy.spatial import ConvexHull

    flat = vertices[:, :2]
    xy = flat @ _rotation(find_least_turn(flat[ConvexHull(flat).vertices]))
    if np.ptp(xy[:, 0]) < np.ptp(xy[:, 1]):
        xy = xy @ _rotation(np.pi / 2)
    out = np.column_stack([xy, vertices[:, 2]])
    low, high = out.min(0), out.max(0)
    return Surface(out - [*((low + high)[:2] / 2), low[2]], surface.faces)


def find_least_turn(hull: Float) -> float:
    """Return the angle by which the smallest rectangle around a convex outline (k, 2) is turned."""
    edges = np.roll(hull, -1, axis=0) - hull
    turns = np.unique(np.round(np.arctan2(edges[:, 1], edges[:, 0]) % (np.pi / 2), 7))
    sizes = np.array([np.ptp(hull @ _rotation(a), axis=0) for a in turns])
    return float(turns[int(np.round(sizes.prod(axis=1), 3).argmin())])


def _rotation(angle: float) -> Float:
    """Return the matrix (2, 2) by which rows are turned by minus the angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def arrange(
    parts: Mapping[str, Surface],
    bed: tuple[float, float, float],
    printer: str,
    gap: float,
) -> dict[str, PlacedPart]:
    """Arrange parts on as few plates as they need.

    Args:
        parts: Surfaces as they are printed, by name.
        bed: Size of the bed, mm.
        printer: Name of the printer for errors.
        gap: Distance between parts and from the bed's edge, mm.

    Raises:
        FabricationError: If no plate holds a part.
    """
    turned = {name: _require_fit(name, s, bed, printer) for name, s in parts.items()}
    room, sizes, alone = _rectangles(turned, bed, gap)
    places = pack(sizes, room)
    plates = 1 + max((p.plate for p in places.values()), default=-1)
    out: dict[str, PlacedPart] = {}
    for name, surface in turned.items():
        vertices = surface.vertices
        if name in alone:
            plate = plates + alone.index(name)
            corner = (np.array(bed[:2]) - np.ptp(vertices[:, :2], axis=0)) / 2
        else:
            place = places[name]
            plate, corner = place.plate, np.array([place.x + gap, place.y + gap])
            if place.turned:
                vertices = np.column_stack([vertices[:, :2] @ _rotation(np.pi / 2), vertices[:, 2]])
        shift = np.append(corner - vertices[:, :2].min(axis=0), 0.0)
        out[name] = PlacedPart(plate, Surface(vertices + shift, surface.faces))
    return out


def count_fewest_plates(
    parts: Mapping[str, Surface],
    bed: tuple[float, float, float],
    printer: str,
    gap: float,
) -> int:
    """Return a number of plates below which `arrange` cannot get.

    Raises:
        FabricationError: As `arrange`.
    """
    turned = {name: _require_fit(name, s, bed, printer) for name, s in parts.items()}
    room, sizes, alone = _rectangles(turned, bed, gap)
    return len(alone) + count_least_plates(sizes, room)


def _rectangles(
    parts: Mapping[str, Surface], bed: tuple[float, float, float], gap: float
) -> tuple[tuple[float, float], dict[str, tuple[float, float]], list[str]]:
    """Return the room on a plate for rectangles, each of which includes the gap on two sides; their
    sizes; and the parts that come nearer to the edge than the gap, which get plates of their own.
    """
    room = (bed[0] - gap, bed[1] - gap)
    sizes, alone = {}, []
    for name, surface in parts.items():
        x, y = np.ptp(surface.bounds, axis=0)[:2]
        size = (float(x) + gap, float(y) + gap)
        if _is_held(room, size):
            sizes[name] = size
        else:
            alone.append(name)
    return room, sizes, alone


def _is_held(room: tuple[float, float], size: tuple[float, float]) -> bool:
    (a, b), (x, y) = sorted(room), sorted(size)
    return x <= a + 1e-9 and y <= b + 1e-9


def fits_bed(surface: Surface, bed: tuple[float, float, float]) -> bool:
    """Return whether the bed holds a part that lies as it is printed, turned if necessary."""
    return _turn_to_fit(surface, bed) is not None


def _turn_to_fit(surface: Surface, bed: tuple[float, float, float]) -> Surface | None:
    """Return the surface turned about the vertical until the bed holds it, or None."""
    for angle in np.radians([0, 90, *range(3, 90, 3)]):
        xy = surface.vertices[:, :2] @ _rotation(angle)
        x, y = np.ptp(xy, axis=0)
        if x <= bed[0] and y <= bed[1] and surface.vertices[:, 2].max() <= bed[2]:
            xy -= (xy.min(0) + xy.max(0)) / 2
            return Surface(np.column_stack([xy, surface.vertices[:, 2]]), surface.faces)
    return None


def _require_fit(
    name: str, surface: Surface, bed: tuple[float, float, float], printer: str
) -> Surface:
    """Return the surface so that the bed holds it, or raise FabricationError."""
    turned = _turn_to_fit(surface, bed)
    if turned is not None:
        return turned
    x, y, z = np.ptp(surface.bounds, axis=0)
    raise FabricationError(
        f"measures {x:.0f} x {y:.0f} x {z:.0f} mm as it is printed and does not fit the bed of"
        f" {printer} ({bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm)",
        code="part-too-large",
        where=name,
        action="Divide it by one more cord plane, make the body smaller, or state another"
        " [fabrication] bed or process",
        part=name,
        size=(float(x), float(y), float(z)),
        printer=printer,
    )
