"""Compute the colors of a section: coarse while its plane is dragged, and fine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...workflow.design.body_section import BodySection, LocatedPoints, Section
from ..workbench.colors import ColorScale, color_bar
from .section_quantities import PointValues, SectionQuantity, range_text
from .section_samples import SectionRequest, SectionSampler

_COARSE_DOTS = 700  # about, of a quantity of one state
_COARSE_DOTS_ALL_STATES = 350  # about, of a quantity of all states, which takes longer
_COMMON_RANGE, _STATE_RANGE = "the same for all states and planes", "of this state"
_OUTLIERS = "1 % of the body is beyond the ends"


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


class SectionRenderer(SectionSampler):
    """Draw sections of one body.

    Args:
        body: The body.
    """

    def __init__(self, body: BodySection) -> None:
        super().__init__(body)
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
        numbers = self.numbers(request, points, located)
        colors = self._scale(request).colors(numbers)
        return self.body.positions(located, points, request.state), colors, step

    def fine(self, request: SectionRequest) -> SectionPicture:
        """Compute the fine section.

        Raises:
            LayoutError: The plane misses the body.
        """
        sample = self.sample(request, is_fine=True)
        scale = self._scale(request)
        note = range_text(request.quantity, sample.numbers)
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
            sample.section,
            sample.positions,
            scale.colors(sample.numbers),
            color_bar(scale, request.quantity.title, request.quantity.unit, note),
        )

    def probe(self, picture: SectionPicture, triangle: int, weights: Float) -> PointValues:
        """Return the numbers of a point of a section; see `probe_at`.

        Args:
            picture: The section.
            triangle: Index of the triangle that contains the point.
            weights: Weights (3,) of the triangle's corners.
        """
        corners, located = picture.section.triangles[triangle], picture.section.at
        rest = weights @ picture.section.points[corners]
        at = LocatedPoints(located.cell[corners[:1]], (weights @ located.bary[corners])[None])
        return self.probe_at(picture.request, at, rest)

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
