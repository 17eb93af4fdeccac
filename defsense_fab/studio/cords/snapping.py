"""Snap a dragged control point to another cord, the body's surface or its middle planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.device.device import Sensor
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import nearest_on_section, plane_section

_IN_PLANE_TOLERANCE_MM = 1e-3  # within which a point of another cord belongs to the plane

#: What a point snaps to.
SnapTarget = Literal["cord", "surface", "middle"]


@dataclass(frozen=True)
class Snap:
    """Result of snapping a point.

    Attributes:
        point: (2,) mm in the plane.
        target: What the point has snapped to, or None if it stays where it was.
        cord: Name of the cord whose control point it has snapped to; empty for other targets.
    """

    point: Float
    target: SnapTarget | None = None
    cord: str = ""


class Snapper:
    """Snap the control points of a cord in its plane.

    Args:
        surface: Surface of the body.
        plane: Plane of the cord.
        others: The other cords of the device.
        max_distance: Distance over which points snap, mm.
    """

    def __init__(
        self, surface: Surface, plane: Plane, others: Sequence[Sensor], max_distance: float
    ) -> None:
        self._max_distance = max_distance
        self._section = plane_section(surface, plane)
        self._points: list[tuple[str, Float]] = []
        for sensor in others:
            local = (sensor.plane.to_world(sensor.curve.points) - plane.origin) @ plane.axes
            in_plane = local[np.abs(local[:, 2]) < _IN_PLANE_TOLERANCE_MM]
            self._points += [(sensor.name, point) for point in in_plane[:, :2]]
        v = surface.vertices
        self._middle_lines = _intersection_lines(plane, (v.min(0) + v.max(0)) / 2)

    def snap(self, point: Float) -> Snap:
        """Snap a point (2,) mm of the plane.

        Control points of other cords in this plane come first, then the body's surface, then the
        lines in which the middle planes of the body's box cut the plane, or their intersection.
        """
        gap, nearest, cord = min(
            ((_distance(point, other), other, name) for name, other in self._points),
            key=lambda candidate: candidate[0],
            default=(np.inf, point, ""),
        )
        if gap <= self._max_distance:
            return Snap(nearest, "cord", cord)
        if len(self._section):
            nearest = nearest_on_section(self._section, point)
            if _distance(point, nearest) <= self._max_distance:
                return Snap(nearest, "surface")
        nearest, has_moved = point, False
        for normal, level in self._middle_lines:
            offset = float(normal @ nearest) - level
            if abs(offset) <= self._max_distance:
                nearest, has_moved = nearest - offset * normal, True
        return Snap(nearest, "middle") if has_moved else Snap(point)


def _distance(a: Float, b: Float) -> float:
    return float(np.linalg.norm(a - b))


def _intersection_lines(plane: Plane, middle: Float) -> list[tuple[Float, float]]:
    """Return the lines n . p = level in which the x, y and z planes through `middle` cut a plane.

    Each line has a unit normal n (2,) and a level in mm.
    """
    lines = []
    for axis in range(3):
        normal = plane.axes[axis, :2]
        norm = float(np.linalg.norm(normal))
        if norm > 1e-6:
            level = float(middle[axis] - plane.origin[axis]) / norm
            lines.append((np.asarray(normal / norm), level))
    return lines
