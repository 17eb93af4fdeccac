"""Find where a channel runs along the face of another cord's cut and opens into it.

A channel that crosses such a face steeply only makes a hole in it. One that crosses it at a small
angle, or runs next to it, leaves a wall that fades out over a long way: it is hard to print, and
glue flows into the channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism
from ..kernels.surface_queries import SignedDistance

#: Crossings at a smaller angle are too long.
MIN_CROSSING_ANGLE_RAD = np.radians(20)
PLANE_TOLERANCE_MM = 1e-5
IN_PLANE_MM = 1e-3  # largest distance of a line in a plane from it


@dataclass(frozen=True)
class ChannelOpening:
    """A stretch of a channel that is too near to a face of another cut.

    Attributes:
        line: Index of the channel.
        cut: Index of the cut.
        length: Length of the stretch, mm.
        reach: Largest distance of the stretch from `at`, mm.
        wall: Least wall, mm; below 0 if the channel opens.
        at: Point (3,) of the least wall, mm.
    """

    line: int
    cut: int
    length: float
    reach: float
    wall: float
    at: Float


def cut_planes(normal: Float, origin: Float, region: Prism | None) -> list[tuple[Float, float]]:
    """Return the planes (unit normal (3,), offset in mm) on which the faces of one cut lie."""
    planes = [(normal, float(normal @ origin))]
    if region is not None:
        corners = region.origin + region.polygon @ region.axes[:, :2].T
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            side = np.cross(b - a, region.axes[:, 2])
            side /= np.linalg.norm(side)
            planes.append((side, float(side @ a)))
    return planes


def find_channel_openings(
    leaves: Sequence[Any],
    faces: Sequence[Sequence[tuple[Float, float]]],
    lines: Sequence[tuple[int, Float]],
    radius: float,
    wall: float,
) -> list[ChannelOpening]:
    """Return all stretches of channels too near to a face of another cord's cut that they do not
    just cross.

    Args:
        leaves: The parts (manifold3d solids) without channels.
        faces: Planes of each cut.
        lines: Index and center line (p, 3), mm, of each channel.
        radius: Radius of the channels, mm.
        wall: Least wall, mm.
    """
    surfaces = [triangle_kernel.to_surface(leaf) for leaf in leaves]
    out = []
    for k, planes in enumerate(faces):
        triangles = _facets_in_planes(surfaces, planes)
        if not len(triangles):
            continue
        corners = Surface(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
        distance_to_faces, (normal, offset) = SignedDistance(corners), planes[0]
        for i, line in lines:
            if np.abs(line @ normal - offset).max() < IN_PLANE_MM:
                continue
            out += _find_stretches(i, k, line, distance_to_faces.unsigned(line), radius, wall)
    return out


def _facets_in_planes(surfaces: Sequence[Any], planes: Sequence[tuple[Float, float]]) -> Float:
    """Return the corners (t, 3, 3) of all facets in the planes."""
    corners = [np.zeros((0, 3, 3))]
    for s in surfaces:
        for normal, offset in planes:
            is_in_plane = np.abs(s.vertices @ normal - offset) < PLANE_TOLERANCE_MM
            corners.append(s.vertices[s.faces[is_in_plane[s.faces].all(axis=1)]])
    return np.concatenate(corners)


def _find_stretches(
    i: int, k: int, line: Float, distance: Float, radius: float, wall: float
) -> list[ChannelOpening]:
    step = float(np.linalg.norm(line[1] - line[0]))
    is_near = np.concatenate([[False], distance < radius + wall, [False]])
    edges = np.flatnonzero(np.diff(is_near.astype(int)))
    out = []
    for a, b in edges.reshape(-1, 2):
        nearest = int(a + distance[a:b].argmin())
        crosses = distance[nearest] < step
        allowed_length = 2 * (radius + wall) / np.sin(MIN_CROSSING_ANGLE_RAD) if crosses else 0.0
        if (b - a) * step > allowed_length:
            at, length = line[nearest], float((b - a) * step)
            reach = float(np.linalg.norm(line[a:b] - at, axis=1).max())
            out.append(ChannelOpening(i, k, length, reach, float(distance[nearest]) - radius, at))
    return out
