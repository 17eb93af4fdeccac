"""Draw a cord: planes to draw on, the path of a stroke in a plane, and points that snap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...core.arrays import Float, longest_run
from ...core.curve import Hermite, Plane, arc_lengths, resample
from ...core.curve_conversion import fit_curve
from ...core.device.device import Sensor
from ...core.errors import LayoutError
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import inside_section, nearest_on_section
from ...geometry.kernels.surface_queries import plane_section as plane_section

STROKE_TOLERANCE_MM = 0.5  # between the path and the stroke, about the accuracy of drawing
_STEP_MM = 0.5  # between points of a stroke
_MAX_STROKE_SIZES = 200.0  # largest length of a stroke, times the size of the section
_MAX_EXTENSION_MM = 20.0  # by which ends near the skin are extended to it
_END_DEPTH_MM = 1.0  # of a path's end below the skin; its channel continues straight from there
_AIM_LENGTH_MM = 8.0  # of a stroke's end, which gives its direction
_AXES = "xyz"
_IN_PLANE_TOLERANCE_MM = 1e-3  # within which a point of another cord belongs to the plane

#: What a point snaps to.
SnapTarget = Literal["cord", "surface", "middle"]


def drawing_planes(surface: Surface, sensors: Sequence[Sensor]) -> dict[str, Plane]:
    """Return the planes to draw on by their labels.

    The middle planes of the body's box come first, beginning with the one across the body's thin
    side, each with its x axis along the body. The planes of the cords follow.
    """
    v = surface.vertices
    middle, extent = (v.min(0) + v.max(0)) / 2, np.ptp(v, axis=0)
    order = np.argsort(extent, kind="stable")
    planes = {}
    for axis in order.tolist():
        x_axis = next(a for a in order[::-1].tolist() if a != axis)
        planes[f"middle, normal to {_AXES[axis]}"] = Plane.from_normal(
            middle, np.eye(3)[axis], np.eye(3)[x_axis]
        )
    return planes | {f"of {s.name}": s.plane for s in sensors if s.curve.is_planar}


def offset_plane(plane: Plane, distance: float) -> Plane:
    """Return the plane moved along its normal by a distance in mm."""
    return replace(plane, origin=plane.origin + distance * plane.normal)


def ray_on_plane(plane: Plane, eye: Float, point: Float) -> Float | None:
    """Return where the ray from an eye through a point meets a plane.

    Args:
        plane: The plane.
        eye: Origin of the ray (3,) mm.
        point: A point (3,) mm on the ray.

    Returns:
        Coordinates (2,) mm in the plane; None if the ray is parallel to it or points away.
    """
    ray = point - eye
    rise = float(ray @ plane.normal)
    if abs(rise) < 1e-9 * float(np.linalg.norm(ray)):
        return None
    share = float((plane.origin - eye) @ plane.normal) / rise
    if share <= 0:
        return None
    return np.asarray((eye + share * ray - plane.origin) @ plane.axes[:, :2])


def fit_stroke(surface: Surface, plane: Plane, stroke: Float) -> Hermite:
    """Fit a path to the longest part of a stroke inside the body.

    Ends near the skin are extended to just below it.

    Args:
        surface: The body's surface.
        plane: The plane of the stroke.
        stroke: Points (q, 2) mm in the plane.

    Raises:
        LayoutError: If the plane misses the body, or the stroke is too short or lies outside.
    """
    section = plane_section(surface, plane)
    if not len(section):
        raise LayoutError(
            "the plane misses the body", code="plane-misses-body", action="Move it until it cuts it"
        )
    stroke = np.asarray(stroke, float).reshape(-1, 2)
    stroke = stroke[np.isfinite(stroke).all(axis=1)]
    lengths = arc_lengths(stroke) if len(stroke) > 1 else np.zeros(1)
    if lengths[-1] < _STEP_MM:
        raise LayoutError(
            "the stroke is too short", code="stroke-too-short", action="Draw along the whole cord"
        )
    if lengths[-1] > _MAX_STROKE_SIZES * float(np.ptp(section, axis=(0, 1)).max()):
        raise LayoutError(
            "the stroke is much longer than the body's section",
            code="stroke-too-long",
            action="Draw across the section",
        )
    points = resample(stroke, 0.0, float(lengths[-1]), int(lengths[-1] / _STEP_MM) + 2)
    inside = longest_run(inside_section(section, points))
    if inside.stop - inside.start < 2:
        raise LayoutError(
            "the stroke lies outside of the body's section",
            code="stroke-outside-body",
            action="Draw across the section",
        )
    line = points[inside]
    start = _extend_to_skin(section, line[::-1])
    end = _extend_to_skin(section, line)
    line = np.concatenate([start[::-1], line, end])
    length = float(arc_lengths(line)[-1])
    if length < 2 * _END_DEPTH_MM + _STEP_MM:
        raise LayoutError(
            "the stroke is too short within the body",
            code="stroke-too-short",
            action="Draw along the whole cord",
        )
    trims = [_END_DEPTH_MM if len(extension) else 0.0 for extension in (start, end)]
    return fit_curve(
        resample(line, trims[0], length - trims[1], int(length / _STEP_MM) + 2), STROKE_TOLERANCE_MM
    )


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


def _extend_to_skin(section: Float, line: Float) -> Float:
    """Return points (k, 2) that extend a line (q, 2) straight to the skin, or none if it is far."""
    aim = int(min(_AIM_LENGTH_MM / _STEP_MM, len(line) - 1))
    chord = line[-1] - line[-1 - aim]
    along = chord / np.linalg.norm(chord)
    across = np.array([-along[1], along[0]])
    a, b = ((section[:, k] - line[-1]) @ across for k in (0, 1))
    crossed = (a > 0) != (b > 0)
    share = (a / np.where(crossed, a - b, 1.0))[crossed, None]
    crossings = section[crossed, 0] + share * (section[crossed, 1] - section[crossed, 0])
    ahead = (crossings - line[-1]) @ along
    ahead = ahead[ahead >= 0]
    if not len(ahead) or ahead.min() > _MAX_EXTENSION_MM:
        return line[:0]
    distance = float(ahead.min())
    return np.asarray(
        line[-1] + np.linspace(0, distance, int(distance / _STEP_MM) + 2)[1:, None] * along
    )


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
