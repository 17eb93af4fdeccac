"""Compute the colors of a section: coarse while its plane is dragged, and fine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float
from ...core.curve import Plane
from ...workflow.design.body_section import (
    BodySection,
    Kind,
    LocatedPoints,
    Quantity,
    Section,
    directions_along,
)
from ...workflow.design.next_cord import NextCord
from ..workbench.colors import ColorScale, color_bar
from .section_quantities import PointValues, SectionQuantity, range_text

_COARSE_DOTS = 700  # about, of a quantity of one state
_COARSE_DOTS_ALL_STATES = 350  # about, of a quantity of all states, which takes longer
_FINE_EDGES = 75  # edges of the fine section along the body's largest extent
_COMMON_RANGE, _STATE_RANGE = "the same for all states and planes", "of this state"
_OUTLIERS = "1 % of the body is beyond the ends"
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
class SectionPicture:
    """A fine section.

    Attributes:
        request: What it shows.
        section: The section of the body at rest.
        positions: (v, 3) mm, its vertices in the shown state.
        colors: (v, 3), 0 to 1.
        bar: The color bar as HTML.
    """

    request: SectionRequest
    section: Section
    positions: Float
    colors: Float
    bar: str


class SectionRenderer:
    """Compute sections of one body.

    Args:
        body: The body.
    """

    def __init__(self, body: BodySection) -> None:
        self.body = body
        self._scales: dict[tuple[SectionQuantity, int | None], ColorScale] = {}

    def coarse(self, request: SectionRequest) -> tuple[Float, Float, float]:
        """Compute dots on the section.

        Returns:
            Positions (p, 3) mm in the state, colors (p, 3), and the distance of the dots at rest,
            mm.

        Raises:
            LayoutError: The plane misses the body.
        """
        area = self.body.cut(request.plane).area
        quantity = request.quantity.quantity
        uses_all_states = quantity is not None and quantity.variance
        count = _COARSE_DOTS_ALL_STATES if uses_all_states else _COARSE_DOTS
        step = float(np.sqrt(area / count))
        points, located = self.body.grid(request.plane, step)
        numbers = self._numbers(request, points, located)
        colors = self._scale(request).colors(numbers)
        return self.body.positions(located, points, request.state), colors, step

    def fine(self, request: SectionRequest) -> SectionPicture:
        """Compute the fine section.

        Raises:
            LayoutError: The plane misses the body.
        """
        section = self.body.cut(request.plane).subdivide(self.body.size / _FINE_EDGES)
        numbers = self._numbers(request, section.points, section.at)
        scale = self._scale(request)
        note = range_text(request.quantity, numbers)
        if request.quantity.quantity is not None:
            has_state_range = self._range_state(request) is not None
            range_kind = _STATE_RANGE if has_state_range else _COMMON_RANGE
            note = f"{note}; range {range_kind}; {_OUTLIERS}"
        elif request.next_cord is None:
            note = "computing ..."
        else:
            note = f"{note}; gray: no cord fits"
        return SectionPicture(
            request,
            section,
            self.body.positions(section.at, section.points, request.state),
            scale.colors(numbers),
            color_bar(scale, request.quantity.title, request.quantity.unit, note),
        )

    def probe(self, picture: SectionPicture, triangle: int, weights: Float) -> PointValues:
        """Return the numbers of a point of a section.

        The variance is that of the shown quantity if it has a direction, else that of the largest
        stretch.

        Args:
            picture: The section.
            triangle: Index of the triangle that contains the point.
            weights: Weights (3,) of the triangle's corners.
        """
        corners, request = picture.section.triangles[triangle], picture.request
        located = picture.section.at
        rest = weights @ picture.section.points[corners]
        at = LocatedPoints(located.cell[corners[:1]], (weights @ located.bary[corners])[None])
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

    def _numbers(self, request: SectionRequest, points: Float, at: LocatedPoints) -> Float:
        quantity, cord_map = request.quantity.quantity, request.next_cord
        if quantity is None:
            if cord_map is None:
                return np.full(len(points), np.nan)
            return nearest_drop(cord_map, points)
        direction = request.direction(points)
        return request.quantity.to_shown(self.body.values(at, quantity, request.state, direction))

    def _scale(self, request: SectionRequest) -> ColorScale:
        """Return the color scale; its range does not change while the plane is dragged."""
        quantity, cord_map = request.quantity.quantity, request.next_cord
        if quantity is None:
            return ColorScale.for_gains(np.zeros(0) if cord_map is None else cord_map.drop)
        key = (request.quantity, self._range_state(request))
        if not (request.is_moving and key in self._scales):
            direction = request.direction(self.body.middles)
            reach = self.body.spread(quantity, key[1], direction)
            self._scales[key] = request.quantity.scale(reach)
        return self._scales[key]

    def _range_state(self, request: SectionRequest) -> int | None:
        """Return the state whose range is used, or None for all; rest has no range."""
        uses_state = request.has_state_range and request.quantity.varies_by_state and request.state
        return request.state if uses_state else None


def nearest_drop(cord_map: NextCord, points: Float) -> Float:
    """Return the decrease of the error (p,) mm at rest points (p, 3) mm.

    It is that of the nearest point of the map's grid, and NaN farther away than a grid step.
    """
    if not len(cord_map.points):
        return np.full(len(points), np.nan)
    distance, nearest = cKDTree(cord_map.points).query(points)
    return np.where(distance <= cord_map.step, cord_map.drop[nearest], np.nan)
