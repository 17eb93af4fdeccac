"""Where a point that is dragged comes to lie: on the skin, on the middle, on another cord."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.device.device import Sensor
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import nearest_on_section, plane_section

#: What a point snaps to, as it is told.
SKIN, MIDDLE = "the skin", "the body's middle"


@dataclass(frozen=True)
class Snapped:
    """The place (2,) mm in the plane, and to what it has snapped; nothing where that is empty."""

    place: Float
    to: str = ""


class Snapping:
    """For points of a cord in a `plane` through a body, among `others`: within `reach` mm."""

    def __init__(
        self, surface: Surface, plane: Plane, others: Sequence[Sensor], reach: float
    ) -> None:
        self._reach = reach
        self._section = plane_section(surface, plane)
        self._points: list[tuple[str, Float]] = []
        for s in others:
            local = (s.plane.to_world(s.curve.points) - plane.origin) @ plane.axes
            near = local[np.abs(local[:, 2]) < 1e-3]
            self._points += [(f"`{s.name}`", point) for point in near[:, :2]]
        v = surface.vertices
        self._middles = _traces(plane, (v.min(0) + v.max(0)) / 2)

    def __call__(self, place: Float) -> Snapped:
        """Of a place (2,) mm: the nearest of the points of other cords in this plane; else of the
        skin; else of where the middle planes of the body's box cut this one, or their crossing."""
        gap, at, to = min(
            ((_gap(place, at), at, to) for to, at in self._points),
            key=lambda found: found[0],
            default=(np.inf, place, ""),
        )
        if gap <= self._reach:
            return Snapped(at, to)
        if len(self._section):
            at = nearest_on_section(self._section, place)
            if _gap(place, at) <= self._reach:
                return Snapped(at, SKIN)
        at, moved = place, False
        for normal, level in self._middles:
            off = float(normal @ at) - level
            if abs(off) <= self._reach:
                at, moved = at - off * normal, True
        return Snapped(at, MIDDLE) if moved else Snapped(place)


def _gap(a: Float, b: Float) -> float:
    return float(np.linalg.norm(a - b))


def _traces(plane: Plane, middle: Float) -> list[tuple[Float, float]]:
    """The lines n . p = level in which the planes x, y and z through the `middle` (3,) cut a plane:
    unit n (2,) and level, mm."""
    out = []
    for axis in range(3):
        across = plane.axes[axis, :2]
        size = float(np.linalg.norm(across))
        if size > 1e-6:
            level = float(middle[axis] - plane.origin[axis]) / size
            out.append((np.asarray(across / size), level))
    return out
