"""Parts on the bed of a printer: cut face down, turned to take little room, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import frame
from .packing import least_plates, pack

#: First layer that holds a part on the bed, mm^2.
FOOTHOLD = 20.0
_LAYER, _LINE, _TRIED = 0.15, 0.4, 40  # mm above the bed, width of a line, sides of the hull
GAP = 5.0  # mm, between parts and along the bed's edge


@dataclass(frozen=True)
class PlacedPart:
    """A part on a plate (counted from 0): its surface moved and turned, in mm from the plate's
    front left corner."""

    plate: int
    surface: Surface


def resting(surface: Surface, preferred: Sequence[Float]) -> Float:
    """The direction (3,) that points down as a part is printed: the first of the `preferred` ones
    in which it ends in a flat, or else, of these, the sides of its convex hull and its main axes,
    the one with the largest first layer."""
    solid = triangle_kernel.to_manifold(surface, "a part")
    for normal in preferred:
        if first_layer_area(solid, normal) >= FOOTHOLD:
            return normal
    return max([*preferred, *_sides(surface)], key=lambda normal: first_layer_area(solid, normal))


def other_side(surface: Surface, bed: tuple[float, float, float]) -> Float | None:
    """The direction (3,) that points down where a part lies with the largest first layer of those
    sides on which the bed holds it; None where it holds it on none."""
    solid = triangle_kernel.to_manifold(surface, "a part")
    held = [normal for normal in _sides(surface) if fits(laid(surface, normal), bed)]
    return max(held, key=lambda normal: first_layer_area(solid, normal), default=None)


def _sides(surface: Surface) -> list[Float]:
    """The largest sides of the convex hull, and the main axes: directions (3,) to lie on."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(surface.vertices)
    a, b, c = (hull.points[hull.simplices[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    normals, own = np.unique(np.round(hull.equations[:, :3], 2), axis=0, return_inverse=True)
    wide = np.round(np.bincount(own.reshape(-1), area), 6)
    widest = np.argsort(-wide, kind="stable")[:_TRIED]
    around = np.linalg.svd(hull.points - hull.points.mean(0), full_matrices=False)[2]
    flats = normals[widest] / np.linalg.norm(normals[widest], axis=1)[:, None]
    return [*flats, *around, *-around]


def first_layer_area(solid: Any, down: Float) -> float:
    """Area, mm^2, of a part's first layer (manifold3d solid) that two lines of the printer fill."""
    lying = solid.transform(np.column_stack([frame(-down).T, np.zeros(3)]))
    layer = lying.slice(lying.bounding_box()[2] + _LAYER)
    return float(layer.offset(-_LINE).offset(_LINE).area())


def laid(surface: Surface, down: Float) -> Surface:
    """The surface with the direction `down` (3,) below, turned about the vertical so that the
    rectangle around it is least, its middle at x = y = 0, on z = 0."""
    vertices = surface.vertices @ frame(-down)
    from scipy.spatial import ConvexHull

    flat = vertices[:, :2]
    xy = flat @ _turn(least_turn(flat[ConvexHull(flat).vertices]))
    if np.ptp(xy[:, 0]) < np.ptp(xy[:, 1]):
        xy = xy @ _turn(np.pi / 2)
    out = np.column_stack([xy, vertices[:, 2]])
    low, high = out.min(0), out.max(0)
    return Surface(out - [*((low + high)[:2] / 2), low[2]], surface.faces)


def least_turn(hull: Float) -> float:
    """The angle by which the rectangle around a convex outline (k, 2) of least area is turned."""
    edges = np.roll(hull, -1, axis=0) - hull
    turns = np.unique(np.round(np.arctan2(edges[:, 1], edges[:, 0]) % (np.pi / 2), 7))
    sizes = np.array([np.ptp(hull @ _turn(a), axis=0) for a in turns])
    return float(turns[int(np.round(sizes.prod(axis=1), 3).argmin())])


def _turn(angle: float) -> Float:
    """Rows times this are turned by minus the angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def arrange(
    parts: Mapping[str, Surface],
    bed: tuple[float, float, float],
    printer: str,
    gap: float = GAP,
) -> dict[str, PlacedPart]:
    """Parts that lie as they are printed, on as few plates as they need, `gap` mm apart and from
    the bed's edge.

    Raises FabricationError for a part that no plate holds.
    """
    turned = {name: _fitting(name, s, bed, printer) for name, s in parts.items()}
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
                vertices = np.column_stack([vertices[:, :2] @ _turn(np.pi / 2), vertices[:, 2]])
        shift = np.append(corner - vertices[:, :2].min(axis=0), 0.0)
        out[name] = PlacedPart(plate, Surface(vertices + shift, surface.faces))
    return out


def count_fewest_plates(
    parts: Mapping[str, Surface],
    bed: tuple[float, float, float],
    printer: str,
    gap: float = GAP,
) -> int:
    """A number of plates below which `arrange` cannot get, however it lays the rectangles around
    the parts. Raises FabricationError as it does."""
    turned = {name: _fitting(name, s, bed, printer) for name, s in parts.items()}
    room, sizes, alone = _rectangles(turned, bed, gap)
    return len(alone) + least_plates(sizes, room)


def _rectangles(
    parts: Mapping[str, Surface], bed: tuple[float, float, float], gap: float
) -> tuple[tuple[float, float], dict[str, tuple[float, float]], list[str]]:
    """The room on a plate for rectangles, each of which brings the gap on two of its sides; their
    sizes; and the parts that come nearer to the edge than the gap, for a plate of their own."""
    room = (bed[0] - gap, bed[1] - gap)
    sizes, alone = {}, []
    for name, surface in parts.items():
        x, y = np.ptp(surface.bounds, axis=0)[:2]
        size = (float(x) + gap, float(y) + gap)
        if _holds(room, size):
            sizes[name] = size
        else:
            alone.append(name)
    return room, sizes, alone


def _holds(room: tuple[float, float], size: tuple[float, float]) -> bool:
    (a, b), (x, y) = sorted(room), sorted(size)
    return x <= a + 1e-9 and y <= b + 1e-9


def fits(surface: Surface, bed: tuple[float, float, float]) -> bool:
    """Whether the bed holds a part that lies as it is printed, turned as it may be."""
    return _on_bed(surface, bed) is not None


def _on_bed(surface: Surface, bed: tuple[float, float, float]) -> Surface | None:
    """The surface as it is, or turned about the vertical until the bed holds it."""
    for angle in np.radians([0, 90, *range(3, 90, 3)]):
        xy = surface.vertices[:, :2] @ _turn(angle)
        x, y = np.ptp(xy, axis=0)
        if x <= bed[0] and y <= bed[1] and surface.vertices[:, 2].max() <= bed[2]:
            xy -= (xy.min(0) + xy.max(0)) / 2
            return Surface(np.column_stack([xy, surface.vertices[:, 2]]), surface.faces)
    return None


def _fitting(name: str, surface: Surface, bed: tuple[float, float, float], printer: str) -> Surface:
    """The surface so that the bed holds it. Raises FabricationError."""
    found = _on_bed(surface, bed)
    if found is not None:
        return found
    x, y, z = np.ptp(surface.bounds, axis=0)
    raise FabricationError(
        f"{name} measures {x:.0f} x {y:.0f} x {z:.0f} mm as it is printed and does not fit the bed"
        f" of {printer} ({bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm): divide it by one more cord"
        " plane, make the body smaller, or state another [fabrication] bed or process",
        code="part-too-large",
        part=name,
        size=(float(x), float(y), float(z)),
        printer=printer,
    )
