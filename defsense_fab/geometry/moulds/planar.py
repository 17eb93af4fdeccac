"""Work with manifold3d solids in the frame of a plane."""

from __future__ import annotations

from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import axes_from_normal
from ..parts.part_contacts import inside_outlines
from .records import Face

SECTION_OFFSET_MM = 1e-3  # from a face, where its section is taken
MAX_SLIVER_MM3 = 1e-3
LIFT_DISTANCES_MM = (0.2, 0.6, 1.5, 4.0)  # of a core that is taken out


def to_plane_frame(solid: Any, axes: Float, origin: Float) -> Any:
    """Return the solid in the frame with `axes` (3, 3) and `origin` (3,), mm."""
    return solid.transform(np.column_stack([axes.T, -axes.T @ origin]))


def from_plane_frame(solid: Any, axes: Float, origin: Float) -> Any:
    """Return the solid of a frame in the rest frame: the inverse of `to_plane_frame`."""
    return solid.transform(np.column_stack([axes, origin]))


def bridge_face(solid: Any, normal: Float, origin: Float, above: float) -> Any:
    """Return a thin prism on a solid's section just below a face, up to `above` mm over it.

    Two solids that would only meet in the face overlap with it, so that no film stays between them.
    """
    axes = axes_from_normal(normal)
    section = to_plane_frame(solid, axes, origin).slice(-SECTION_OFFSET_MM)
    prism = m3.Manifold.extrude(section, above + 2 * SECTION_OFFSET_MM).translate(
        [0, 0, -2 * SECTION_OFFSET_MM]
    )
    return from_plane_frame(prism, axes, origin)


def find_core_cover(shell: Any, face: Face) -> Any:
    """Return the part of a mould's shell that blocks a face's core as it is taken out, or None.

    The part includes a little more around it.
    """
    axes = axes_from_normal(face.normal)
    core, around = (
        to_plane_frame(face.core, axes, face.origin),
        to_plane_frame(shell, axes, face.origin),
    )
    covers = []
    for distance in LIFT_DISTANCES_MM:
        for overlap in (core.translate([0, 0, distance]) ^ around).decompose():
            if overlap.volume() > MAX_SLIVER_MM3:
                x0, y0, _, x1, y1, _ = overlap.bounding_box()
                box = m3.Manifold.cube([x1 - x0 + 1, y1 - y0 + 1, 200]).translate(
                    [x0 - 0.5, y0 - 0.5, -200]
                )
                nearby_core = core ^ box
                low = nearby_core.bounding_box()[2]
                covers.append(
                    m3.Manifold.extrude(nearby_core.project(), -low).translate([0, 0, low])
                )
    if not covers:
        return None
    cover = triangle_kernel.union(covers) ^ around
    return from_plane_frame(cover, axes, face.origin) if cover.volume() > MAX_SLIVER_MM3 else None


def widen(solid: Any, normal: Float, by: float) -> Any:
    """Return the union of a solid and copies moved `by` mm all around, across `normal`."""
    axes = axes_from_normal(normal)
    turns = np.arange(8) * np.pi / 4
    offsets = by * np.stack([np.cos(turns), np.sin(turns)], axis=1) @ axes[:, :2].T
    return triangle_kernel.union([solid, *(solid.translate(w.tolist()) for w in offsets)])


def find_spots(section: Any, room: float, max_spots: int = 400) -> Float:
    """Return points (n, 2) of a CrossSection that keep `room` mm from its outline."""
    inner = section.offset(-room)
    outlines = [np.asarray(p, float) for p in inner.to_polygons()]
    if not outlines:
        return np.zeros((0, 2))
    x0, y0, x1, y1 = inner.bounds()
    step = max(0.5, float(np.sqrt(max(inner.area(), 1e-6) / max_spots)))
    axes = [np.arange(a, b + step, step) for a, b in ((x0, x1), (y0, y1))]
    grid = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    return np.concatenate([*outlines, grid[inside_outlines(grid, outlines)]])


def spread_points(points: Float, count: int, min_distance: float, chosen_before: Float) -> Float:
    """Choose points far from each other.

    Args:
        points: Candidates (n, 2), mm.
        count: Largest number of points.
        min_distance: Least distance between points, mm.
        chosen_before: Points (k, 2) chosen before.

    Returns:
        Points, each as far as possible from those before.
    """
    chosen = list(chosen_before)
    out: list[Float] = []
    for _ in range(count):
        if not len(points):
            break
        if chosen:
            distance = np.linalg.norm(points[:, None] - np.array(chosen)[None], axis=2).min(axis=1)
        else:
            distance = np.linalg.norm(points - points.mean(axis=0), axis=1) + min_distance
        k = int(np.round(distance, 6).argmax())
        if distance[k] < min_distance:
            break
        chosen.append(points[k])
        out.append(points[k])
    return np.array(out).reshape(-1, 2)
