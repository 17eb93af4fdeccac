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
    from scipy.spatial import ConvexHull

    solid = triangle_kernel.to_manifold(surface, "a part")
    for normal in preferred:
        if footing(solid, normal) >= FOOTHOLD:
            return normal
    hull = ConvexHull(surface.vertices)
    a, b, c = (hull.points[hull.simplices[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    normals, own = np.unique(np.round(hull.equations[:, :3], 2), axis=0, return_inverse=True)
    widest = np.argsort(-np.bincount(own.reshape(-1), area))[:_TRIED]
    around = np.linalg.svd(hull.points - hull.points.mean(0), full_matrices=False)[2]
    flats = normals[widest] / np.linalg.norm(normals[widest], axis=1)[:, None]
    sides = [*preferred, *flats, *around, *-around]
    return max(sides, key=lambda normal: footing(solid, normal))


def footing(solid: Any, down: Float) -> float:
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
    parts: Mapping[str, Surface], bed: tuple[float, float, float], printer: str
) -> dict[str, PlacedPart]:
    """Parts that lie as they are printed, on as many plates as they need, in rows from the front.

    Raises FabricationError for a part that no plate holds.
    """
    turned = {name: _fitting(name, s, bed, printer) for name, s in parts.items()}
    sizes = {name: np.ptp(s.bounds, axis=0)[:2] for name, s in turned.items()}
    out: dict[str, PlacedPart] = {}
    plate, x, y, row = 0, GAP, GAP, 0.0
    for name in sorted(turned, key=lambda n: -sizes[n][1]):
        wide, deep = sizes[name]
        if x > GAP and x + wide + GAP > bed[0]:
            x, y, row = GAP, y + row + GAP, 0.0
        if y > GAP and y + deep + GAP > bed[1]:
            plate, x, y, row = plate + 1, GAP, GAP, 0.0
        if x + wide + GAP > bed[0] or y + deep + GAP > bed[1]:  # alone, nearer than GAP to the edge
            plate += any(p.plate == plate for p in out.values())
            middle = np.array([bed[0] / 2, bed[1] / 2, 0.0])
            x, y, row = bed[0], GAP, bed[1]
        else:
            middle = np.array([x + wide / 2, y + deep / 2, 0.0])
            x, row = x + wide + GAP, max(row, deep)
        s = turned[name]
        out[name] = PlacedPart(plate, Surface(s.vertices + middle, s.faces))
    return out


def _fitting(name: str, surface: Surface, bed: tuple[float, float, float], printer: str) -> Surface:
    """The surface as it is, or turned about the vertical until the bed holds it."""
    for angle in np.radians([0, 90, *range(3, 90, 3)]):
        xy = surface.vertices[:, :2] @ _turn(angle)
        x, y = np.ptp(xy, axis=0)
        if x <= bed[0] and y <= bed[1] and surface.vertices[:, 2].max() <= bed[2]:
            xy -= (xy.min(0) + xy.max(0)) / 2
            return Surface(np.column_stack([xy, surface.vertices[:, 2]]), surface.faces)
    x, y, z = np.ptp(surface.bounds, axis=0)
    raise FabricationError(
        f"{name} measures {x:.0f} x {y:.0f} x {z:.0f} mm as it is printed and does not fit the bed"
        f" of {printer} ({bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm): divide it by one more cord"
        " plane, make the body smaller, or choose another process"
    )
