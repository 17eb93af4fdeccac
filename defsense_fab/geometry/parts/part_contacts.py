"""Find the faces along which parts meet, and how much room there is in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float
from ...core.curve import Plane, arc_lengths, resample
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.surface_queries import inside_outlines, signed_distance_of
from .channel_openings import IN_PLANE_MM
from .division import Division

SECTION_OFFSET_MM = 0.02  # parts are cut this far from their common plane
OUTLINE_TOLERANCE_MM = 0.01  # by which outlines may differ from the faces
MIN_CONTACT_MM2 = 1.0  # smaller faces are ignored


@dataclass(frozen=True)
class Contact:
    """A face in which two parts meet.

    Attributes:
        cut: Index of the cut in whose plane it lies.
        lower: Index of the part below.
        upper: Index of the part above.
        plane: The plane.
        section: The common face without grooves (a manifold3d CrossSection in the plane, mm).
        walls: The parts' other faces, without channels.
        hollows: Points along each channel (a k-d tree), and its radius, mm.
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
        """Outlines (k, 2) of the common face, mm: outer ones counter-clockwise."""
        return [np.asarray(p, float) for p in self.section.to_polygons()]

    @property
    def area(self) -> float:
        """Area of the face, mm^2."""
        return float(self.section.area())

    def distance(self, points: Float, max_distance: float) -> Float:
        """Return the distance of points from the two parts' surfaces, except their common face.

        Args:
            points: Points (n, 3), mm.
            max_distance: Distance up to which it matters, mm.

        Returns:
            Distances (n,) to skin, channels and other cuts, mm; below zero within a channel.
        """
        if not len(points):
            return np.zeros(0)
        distances = np.minimum(signed_distance_of(self.walls).unsigned(points), max_distance)
        for tree, radius in self.hollows:
            away = tree.query(points, distance_upper_bound=max_distance + radius)[0] - radius
            distances = np.minimum(distances, away)
        return np.asarray(distances)

    def spots(self, room: float, max_spots: int = 250) -> Float:
        """Return points of the face that keep `room` mm from its outline.

        They are a grid and points along the border of the remaining face, which may be too narrow
        for any grid.

        Returns:
            Points (n, 2), mm.
        """
        inner = self.section.offset(-room)
        outlines = [np.asarray(p, float) for p in inner.to_polygons()]
        if not outlines:
            return np.zeros((0, 2))
        step = max(0.5, float(np.sqrt(inner.area() / max_spots)))
        x0, y0, x1, y1 = inner.bounds()
        axes = [_centered(a, b, step) for a, b in ((x0, x1), (y0, y1))]
        grid = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
        border = np.concatenate([_along(p, 2 * step) for p in outlines])
        return np.concatenate([border, grid[inside_outlines(grid, outlines)]])

    def crossings(self, line: Float, room: float) -> list[tuple[Float, float]]:
        """Return where a line passes through the face; a run in the face's plane does not.

        Args:
            line: Points (p, 3), mm.
            room: How far outside of the face's outline a crossing may be, mm: the face has no
                material where channels pass through it.

        Returns:
            The point (3,) of each crossing, mm, and the sine of the angle between line and face.
        """
        heights = (line - self.plane.origin) @ self.plane.normal
        off = np.flatnonzero(np.abs(heights) >= IN_PLANE_MM)
        found = []
        for i, k in pairwise(off):
            if heights[i] * heights[k] > 0 or k - i > 2:  # a run in the plane is a groove
                continue
            step = line[k] - line[i]
            point = line[i] + heights[i] / (heights[i] - heights[k]) * step
            if self.is_near(point, room):
                sine = abs(step @ self.plane.normal) / np.linalg.norm(step)
                found.append((point, float(sine)))
        return found

    def is_near(self, point: Float, room: float) -> bool:
        """Return whether a point (3,), projected to the plane, is within `room` mm of the face."""
        flat = (point - self.plane.origin) @ self.plane.axes[:, :2]
        outlines = [np.asarray(p, float) for p in self.section.offset(room).to_polygons()]
        return bool(inside_outlines(flat[None], outlines)[0])

    def world(self, points: Float) -> Float:
        """Return points (n, 2) of the plane in the rest frame (n, 3)."""
        return self.plane.to_world(points)


def find_contacts(division: Division, hollows: Sequence[tuple[Float, float]]) -> list[Contact]:
    """Return every pair of parts that meet in the plane of a cut.

    Args:
        division: The parts.
        hollows: Points (n, 3) along all channels, and their radii, mm.
    """
    parts = division.parts
    surfaces = [triangle_kernel.to_surface(p) for p in division.leaves]
    trees = tuple((cKDTree(points), radius) for points, radius in hollows)
    out = []
    for k, cut in enumerate(division.cuts):
        axes, origin = cut.plane.axes, cut.plane.origin
        below, above = (
            {i: triangle_kernel.to_plane_frame(parts[i], axes, origin).slice(h) for i in side}
            for side, h in zip(cut.sides, (-SECTION_OFFSET_MM, SECTION_OFFSET_MM), strict=True)
        )
        for i, a in below.items():
            for j, b in above.items():
                common = (a ^ b).simplify(OUTLINE_TOLERANCE_MM)
                if common.area() > MIN_CONTACT_MM2:
                    walls = _other_faces([surfaces[i], surfaces[j]], cut.plane)
                    out.append(Contact(k, i, j, cut.plane, common, walls, trees))
    return out


def _other_faces(surfaces: Sequence[Surface], plane: Plane) -> Surface:
    """Return the facets that do not lie in the plane."""
    vertices = np.concatenate([s.vertices for s in surfaces])
    first = np.cumsum([0] + [len(s.vertices) for s in surfaces[:-1]])
    faces = np.concatenate([s.faces + n for s, n in zip(surfaces, first, strict=True)])
    is_off_plane = np.abs((vertices - plane.origin) @ plane.normal) > 1e-5
    keep = is_off_plane[faces].any(axis=1)
    return Surface(np.ascontiguousarray(vertices), np.ascontiguousarray(faces[keep]))


def _centered(low: float, high: float, step: float) -> Float:
    count = max(1, int((high - low) / step))
    return np.asarray((low + high) / 2 + step * (np.arange(count) - (count - 1) / 2))


def _along(polygon: Float, step: float) -> Float:
    """Return points (n, 2) around a closed outline, `step` mm apart."""
    closed = np.concatenate([polygon, polygon[:1]])
    around = float(arc_lengths(closed)[-1])
    return resample(closed, 0.0, around, max(4, int(around / step)) + 1)[:-1]
