"""Where a channel runs along the face of another cord's cut, and opens into it.

A channel that crosses such a face steeply only makes a hole in it. One that crosses it at a small
angle, or runs beside it, leaves a wall that fades out over a long way: hard to print, and glue
finds its way into the channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import igl
import numpy as np

from ...core.arrays import Float
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism

#: A crossing at less than this angle is too long, rad.
_STEEP = np.radians(20)
_FLAT = 1e-5  # mm


@dataclass(frozen=True)
class ChannelOpening:
    """The channel `line` (an index) has less than the wall to a face of the cut `cut` (an index)
    over `length` mm, around `at` (3,) mm, and `wall` mm at the least, below 0 where it opens."""

    line: int
    cut: int
    length: float
    wall: float
    at: Float


def borders(normal: Float, origin: Float, region: Prism | None) -> list[tuple[Float, float]]:
    """Planes (normal (3,), offset mm) on which the faces of one cut lie."""
    planes = [(normal, float(normal @ origin))]
    if region is not None:
        corners = region.origin + region.polygon @ region.axes[:, :2].T
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            side = np.cross(b - a, region.axes[:, 2])
            side /= np.linalg.norm(side)
            planes.append((side, float(side @ a)))
    return planes


def channel_openings(
    leaves: Sequence[Any],
    faces: Sequence[Sequence[tuple[Float, float]]],
    lines: Sequence[tuple[int, Float]],
    radius: float,
    wall: float,
) -> list[ChannelOpening]:
    """All stretches of the channels (index and centre line (p, 3) mm, of `radius` mm) that keep
    less than `wall` mm from a face of another cord's cut and do not just cross it.

    `leaves` are the parts (manifold3d solids) without channels, `faces` each cut's planes.
    """
    surfaces = [triangle_kernel.to_surface(leaf) for leaf in leaves]
    out = []
    for k, planes in enumerate(faces):
        triangles = _lying_on(surfaces, planes)
        if not len(triangles):
            continue
        index = np.arange(3 * len(triangles)).reshape(-1, 3)
        normal, offset = planes[0]
        for i, line in lines:
            if np.abs(line @ normal - offset).max() < 1e-3:
                continue  # its own plane
            square = igl.point_mesh_squared_distance(line, triangles.reshape(-1, 3), index)[0]
            out += _stretches(i, k, line, np.sqrt(np.asarray(square)), radius, wall)
    return out


def _lying_on(surfaces: Sequence[Any], planes: Sequence[tuple[Float, float]]) -> Float:
    """Corners (t, 3, 3) of all facets in the planes."""
    found = [np.zeros((0, 3, 3))]
    for s in surfaces:
        for normal, offset in planes:
            on = np.abs(s.vertices @ normal - offset) < _FLAT
            found.append(s.vertices[s.faces[on[s.faces].all(axis=1)]])
    return np.concatenate(found)


def _stretches(
    i: int, k: int, line: Float, distance: Float, radius: float, wall: float
) -> list[ChannelOpening]:
    step = float(np.linalg.norm(line[1] - line[0]))
    near = np.concatenate([[False], distance < radius + wall, [False]])
    edges = np.flatnonzero(np.diff(near.astype(int)))
    out = []
    for a, b in edges.reshape(-1, 2):
        least = int(a + distance[a:b].argmin())
        crosses = distance[least] < step
        spare = 2 * (radius + wall) / np.sin(_STEEP) if crosses else 0.0
        if (b - a) * step > spare:
            out.append(
                ChannelOpening(
                    i, k, float((b - a) * step), float(distance[least]) - radius, line[least]
                )
            )
    return out
