"""Solids (manifold3d) in the frame of a plane."""

from __future__ import annotations

from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import frame
from ..parts.part_contacts import inside
from .records import Face

_BESIDE = 1e-3  # mm, from a face, where its section is taken
_SLIVER = 1e-3  # mm^3
_LIFTED = (0.2, 0.6, 1.5, 4.0)  # mm, of a core that is taken out


def flat(solid: Any, axes: Float, origin: Float) -> Any:
    """The solid in the frame with `axes` (3, 3) and `origin` (3,) mm."""
    return solid.transform(np.column_stack([axes.T, -axes.T @ origin]))


def upright(solid: Any, axes: Float, origin: Float) -> Any:
    """The inverse of `flat`."""
    return solid.transform(np.column_stack([axes, origin]))


def through(solid: Any, normal: Float, origin: Float, above: float) -> Any:
    """A thin prism on the solid's section just below a face, up to `above` mm over it: two solids
    that would meet in the face overlap with it, so that no film stays between them."""
    axes = frame(normal)
    section = flat(solid, axes, origin).slice(-_BESIDE)
    prism = m3.Manifold.extrude(section, above + 2 * _BESIDE).translate([0, 0, -2 * _BESIDE])
    return upright(prism, axes, origin)


def over_core(shell: Any, face: Face) -> Any:
    """What of a mould's shell lies in the way of a face's core as it is taken out, with a little
    more beside it, or None."""
    axes = frame(face.normal)
    core, around = flat(face.core, axes, face.origin), flat(shell, axes, face.origin)
    found = []
    for far in _LIFTED:
        for met in (core.translate([0, 0, far]) ^ around).decompose():
            if met.volume() > _SLIVER:
                x0, y0, _, x1, y1, _ = met.bounding_box()
                box = m3.Manifold.cube([x1 - x0 + 1, y1 - y0 + 1, 200]).translate(
                    [x0 - 0.5, y0 - 0.5, -200]
                )
                near = core ^ box
                low = near.bounding_box()[2]
                found.append(m3.Manifold.extrude(near.project(), -low).translate([0, 0, low]))
    if not found:
        return None
    over = triangle_kernel.union(found) ^ around
    return upright(over, axes, face.origin) if over.volume() > _SLIVER else None


def widened(solid: Any, normal: Float, by: float) -> Any:
    """The solid and copies of it moved all around, across `normal`."""
    axes = frame(normal)
    turns = np.arange(8) * np.pi / 4
    ways = by * np.stack([np.cos(turns), np.sin(turns)], axis=1) @ axes[:, :2].T
    return triangle_kernel.union([solid, *(solid.translate(w.tolist()) for w in ways)])


def spots(section: Any, room: float, most: int = 400) -> Float:
    """Points (n, 2) of a section (CrossSection) that keep `room` mm from its outline."""
    inner = section.offset(-room)
    outlines = [np.asarray(p, float) for p in inner.to_polygons()]
    if not outlines:
        return np.zeros((0, 2))
    x0, y0, x1, y1 = inner.bounds()
    step = max(0.5, float(np.sqrt(max(inner.area(), 1e-6) / most)))
    axes = [np.arange(a, b + step, step) for a, b in ((x0, x1), (y0, y1))]
    grid = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    return np.concatenate([*outlines, grid[inside(grid, outlines)]])


def farthest(points: Float, count: int, least: float, known: Float) -> Float:
    """Up to `count` of the points (n, 2), each as far as it can be from those chosen before and
    from the `known` ones (k, 2), none nearer than `least` mm to another."""
    chosen = list(known)
    out: list[Float] = []
    for _ in range(count):
        if not len(points):
            break
        if chosen:
            away = np.linalg.norm(points[:, None] - np.array(chosen)[None], axis=2).min(axis=1)
        else:
            away = np.linalg.norm(points - points.mean(axis=0), axis=1) + least
        k = int(np.round(away, 6).argmax())
        if away[k] < least:
            break
        chosen.append(points[k])
        out.append(points[k])
    return np.array(out).reshape(-1, 2)
