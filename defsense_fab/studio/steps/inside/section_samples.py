"""Compute the numbers of a section: its triangles in a state, and a value at each vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ....core.arrays import Float
from ....core.curve import Plane
from ....workflow.design.body_section import (
    BodySection,
    Kind,
    LocatedPoints,
    Quantity,
    Section,
    directions_along,
)
from ....workflow.design.next_cord import NextCord
from .section_quantities import PointValues, SectionQuantity

_FINE_EDGES = 75  # edges of the fine section along the body's largest extent
_STRETCH_NAMES: dict[str, Kind] = {
    "along the direction": "along",
    "largest": "largest",
    "smallest": "smallest",
}


@dataclass(frozen=True)
class SectionRequest:
    """A section to draw.

    Attributes:
        plane: Its plane, in the body at rest.
        state: Index of the state, 0 for rest.
        quantity: The quantity that its colors show.
        angle: Direction of the stretch in the plane, radians from the plane's x axis.
        path: (q, 3) mm, path of a cord whose local direction replaces the angle, or None.
        cords: Paths of all cords, (p, 3) mm each.
        next_cord: The map of the benefit of another cord, once it is computed.
        has_state_range: Whether the range of the colors is that of this state alone.
        is_moving: Whether a user is dragging the plane.
    """

    plane: Plane
    state: int
    quantity: SectionQuantity
    angle: float
    path: Float | None
    cords: tuple[Float, ...]
    next_cord: NextCord | None
    has_state_range: bool
    is_moving: bool = False

    def direction(self, points: Float) -> Float:
        """Return the direction at rest points (p, 3) mm: (3,), or (p, 3) along a cord."""
        if self.path is not None:
            return directions_along(self.path, points)
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.asarray(self.plane.axes[:, :2] @ [c, s])


@dataclass(frozen=True)
class SectionSample:
    """A section with a number at each vertex.

    Attributes:
        section: The section of the body at rest.
        positions: (v, 3) mm, its vertices in the shown state.
        numbers: (v,) numbers as the color bar shows them; NaN where unknown.
    """

    section: Section
    positions: Float
    numbers: Float


class SectionSampler:
    """Compute sections of one body.

    Args:
        body: The body.
    """

    def __init__(self, body: BodySection) -> None:
        self.body = body

    def sample(self, request: SectionRequest, *, is_fine: bool) -> SectionSample:
        """Compute the numbers of a section.

        Args:
            request: The section.
            is_fine: Whether triangles are divided; otherwise each tet is cut into one or two.

        Raises:
            LayoutError: The plane misses the body.
        """
        section = self.body.cut(request.plane)
        if is_fine:
            section = section.subdivide(self.body.size / _FINE_EDGES)
        return SectionSample(
            section,
            self.body.positions(section.at, section.points, request.state),
            self.numbers(request, section.points, section.at),
        )

    def numbers(self, request: SectionRequest, points: Float, at: LocatedPoints) -> Float:
        """Return the numbers (p,) at located rest points (p, 3) mm."""
        quantity, cord_map = request.quantity.quantity, request.next_cord
        if quantity is None:
            if cord_map is None:
                return np.full(len(points), np.nan)
            return nearest_drop(cord_map, points)
        direction = request.direction(points)
        return request.quantity.to_shown(self.body.values(at, quantity, request.state, direction))

    def probe_at(self, request: SectionRequest, at: LocatedPoints, rest: Float) -> PointValues:
        """Return the numbers of a point.

        The variance is that of the shown quantity if it has a direction, else that of the largest
        stretch.

        Args:
            request: The section that shows it.
            at: The located point.
            rest: Its position (3,) mm at rest.
        """
        direction = request.direction(rest[None])
        stretches = {
            name: float(self.body.values(at, Quantity(kind), request.state, direction)[0])
            for name, kind in _STRETCH_NAMES.items()
        }
        kind: Kind = "along" if request.quantity.needs_direction else "largest"
        spread = Quantity(kind, variance=True)
        variance = float(self.body.values(at, spread, request.state, direction)[0])
        position = self.body.positions(at, rest[None], request.state)[0]
        return PointValues(rest, position, stretches, variance)


def nearest_drop(cord_map: NextCord, points: Float) -> Float:
    """Return the decrease of the error (p,) mm at rest points (p, 3) mm.

    It is that of the nearest point of the map's grid, and NaN farther away than a grid step.
    """
    if not len(cord_map.points):
        return np.full(len(points), np.nan)
    distance, nearest = cKDTree(cord_map.points).query(points)
    return np.where(distance <= cord_map.step, cord_map.drop[nearest], np.nan)
