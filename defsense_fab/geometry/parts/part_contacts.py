"""The faces along which parts meet, and how much room there is in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import igl
import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Bool, Float
from ...core.curve import Plane, arc_lengths, resample
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from .division import Division

_BESIDE = 0.02  # mm; parts are cut this far from their common plane to see their faces
_SIMPLER = 0.01  # mm, by which outlines may differ from the faces
_SMALLEST = 1.0  # mm^2, of a face worth looking at


@dataclass(frozen=True)
class Contact:
    """Where part `lower` meets part `upper` (indices) in the plane of a cut (an index).

    `section` is the common face without grooves (a manifold3d CrossSection in the plane, mm);
    `walls` the parts' other faces without channels, which are `hollows` along points (a k-d tree)
    with a radius (mm).
    """

    cut: int
    lower: int
    upper: int
    plane: Plane
    section: Any
    walls: Surface
    hollows: tuple[tuple[Any, float], ...]

    @property
    def polygons(self) -> list[Float]:
        """Outlines of the common face, each (k, 2) mm: outer ones counter-clockwise."""
        return [np.asarray(p, float) for p in self.section.to_polygons()]

    @property
    def area(self) -> float:
        """Of the face, mm^2."""
        return float(self.section.area())

    @cached_property
    def _tree(self) -> Any:
        tree = igl.AABB()
        tree.init(self.walls.vertices, self.walls.faces)
        return tree

    def distance(self, points: Float, most: float) -> Float:
        """Distances (n,) mm of points (n, 3) from the two parts' surfaces, their common face left
        out: skin, channels and other cuts. Below zero within a channel; up to `most` mm, beyond
        which it does not matter."""
        if not len(points):
            return np.zeros(0)
        square = self._tree.squared_distance(
            self.walls.vertices, self.walls.faces, np.ascontiguousarray(points)
        )[0]
        out = np.minimum(np.sqrt(square), most)
        for tree, radius in self.hollows:
            away = tree.query(points, distance_upper_bound=most + radius)[0] - radius
            out = np.minimum(out, away)
        return np.asarray(out)

    def spots(self, room: float, most: int = 250) -> Float:
        """Points (n, 2) of the face that keep `room` mm from its outline: a grid, and points along
        the border of what is left, which may be too narrow for any grid."""
        inner = self.section.offset(-room)
        outlines = [np.asarray(p, float) for p in inner.to_polygons()]
        if not outlines:
            return np.zeros((0, 2))
        step = max(0.5, float(np.sqrt(inner.area() / most)))
        x0, y0, x1, y1 = inner.bounds()
        axes = [_centred(a, b, step) for a, b in ((x0, x1), (y0, y1))]
        grid = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
        border = np.concatenate([_along(p, 2 * step) for p in outlines])
        return np.concatenate([border, grid[inside(grid, outlines)]])

    def world(self, points: Float, height: float = 0.0) -> Float:
        """Points (n, 2) of the plane, `height` mm above it, in the rest frame (n, 3)."""
        return np.asarray(self.plane.to_world(points) + height * self.plane.normal)


def contacts(division: Division, hollows: Sequence[tuple[Float, float]]) -> list[Contact]:
    """Every pair of parts that meet in the plane of a cut; `hollows` are points (n, 3) mm along
    all channels and their radii there."""
    parts = division.parts
    surfaces = [triangle_kernel.to_surface(p) for p in division.leaves]
    trees = tuple((cKDTree(points), radius) for points, radius in hollows)
    out = []
    for k, cut in enumerate(division.cuts):
        into = np.column_stack([cut.plane.axes.T, -cut.plane.axes.T @ cut.plane.origin])
        below, above = (
            {i: parts[i].transform(into).slice(h) for i in side}
            for side, h in zip(cut.sides, (-_BESIDE, _BESIDE), strict=True)
        )
        for i, a in below.items():
            for j, b in above.items():
                common = (a ^ b).simplify(_SIMPLER)
                if common.area() > _SMALLEST:
                    walls = _walls([surfaces[i], surfaces[j]], cut.plane)
                    out.append(Contact(k, i, j, cut.plane, common, walls, trees))
    return out


def _walls(surfaces: Sequence[Surface], plane: Plane) -> Surface:
    """The facets that do not lie in the plane."""
    vertices = np.concatenate([s.vertices for s in surfaces])
    first = np.cumsum([0] + [len(s.vertices) for s in surfaces[:-1]])
    faces = np.concatenate([s.faces + n for s, n in zip(surfaces, first, strict=True)])
    off = np.abs((vertices - plane.origin) @ plane.normal) > 1e-5
    keep = off[faces].any(axis=1)
    return Surface(np.ascontiguousarray(vertices), np.ascontiguousarray(faces[keep]))


def _centred(low: float, high: float, step: float) -> Float:
    count = max(1, int((high - low) / step))
    return np.asarray((low + high) / 2 + step * (np.arange(count) - (count - 1) / 2))


def _along(polygon: Float, step: float) -> Float:
    """Points (n, 2) around a closed outline, `step` mm apart."""
    closed = np.concatenate([polygon, polygon[:1]])
    around = float(arc_lengths(closed)[-1])
    return resample(closed, 0.0, around, max(4, int(around / step)) + 1)[:-1]


def inside(points: Float, polygons: Sequence[Float]) -> Bool:
    """Which points (n, 2) lie inside of outlines with holes (crossing numbers)."""
    out = np.zeros(len(points), bool)
    for polygon in polygons:
        a, b = polygon, np.roll(polygon, -1, axis=0)
        straddles = (a[:, 1] > points[:, 1:]) != (b[:, 1] > points[:, 1:])
        rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
        x = a[:, 0] + (points[:, 1:] - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
        out ^= (straddles & (points[:, :1] < x)).sum(axis=1) % 2 == 1
    return out
