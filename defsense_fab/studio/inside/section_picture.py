"""A section's colours, coarse while a hand moves its plane, and fine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float
from ...core.curve import Plane
from ...mechanics.elements.point_location import LocatedPoints
from ...mechanics.elements.section import Section
from ...optimize.prediction.body_section import BodySection, Kind, Quantity, directions_along
from ...optimize.prediction.next_cord import NextCord
from .color_scale import color_bar
from .color_scale import Scale
from .section_quantities import Look, reach_words

#: Dots of a coarse section, about, of one state and where all of them count.
_DOTS, _FEWER = 700, 350
_FINE = 75  # edges of a fine one over the body's largest extent
_ALL, _OWN = "the same for all states and planes", "of this state"
_BEYOND = "1 % of the body is beyond the ends"
#: What the stretches of a point are called.
_NAMES: dict[str, Kind] = {
    "along the direction": "along", "largest": "largest", "smallest": "smallest",
}  # fmt: skip


@dataclass(frozen=True)
class Wanted:
    """A `plane` through a `state` (0 is rest), what is looked at there, and along what: an `angle`
    (radians, from the plane's x) or the `path` (q, 3) mm of a cord; the paths of all `cords`; where
    the next one would help, once that is `found`; whether the bar's range is that of this state
    alone; whether a hand is moving the plane."""

    plane: Plane
    state: int
    look: Look
    angle: float
    path: Float | None
    cords: tuple[Float, ...]
    found: NextCord | None
    own_range: bool
    moving: bool = False

    def direction(self, points: Float) -> Float:
        """At rest points (p, 3): (3,), or (p, 3) along a cord."""
        if self.path is not None:
            return directions_along(self.path, points)
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.asarray(self.plane.axes[:, :2] @ [c, s])


@dataclass(frozen=True)
class Picture:
    """A fine section, where its vertices are in the state (v, 3) mm, its colours (v, 3), and the
    bar as HTML."""

    wanted: Wanted
    section: Section
    positions: Float
    colors: Float
    bar: str


class Pictures:
    """Of one body."""

    def __init__(self, body: BodySection) -> None:
        self.body = body
        self._scales: dict[tuple[Look, int | None], Scale] = {}

    def coarse(self, wanted: Wanted) -> tuple[Float, Float, float]:
        """Dots (p, 3) mm where they are in the state, their colours (p, 3), their distance at rest,
        mm. Raises LayoutError where the plane misses the body."""
        area = self.body.cut(wanted.plane).area
        quantity = wanted.look.quantity
        few = quantity is not None and quantity.variance
        step = float(np.sqrt(area / (_FEWER if few else _DOTS)))
        points, at = self.body.grid(wanted.plane, step)
        numbers = self._numbers(wanted, points, at)
        colors = self._scale(wanted).colors(numbers)
        return self.body.positions(at, points, wanted.state), colors, step

    def fine(self, wanted: Wanted) -> Picture:
        """Raises LayoutError where the plane misses the body."""
        section = self.body.cut(wanted.plane).subdivide(self.body.size / _FINE)
        numbers = self._numbers(wanted, section.points, section.at)
        scale = self._scale(wanted)
        note = reach_words(wanted.look, numbers)
        if wanted.look.quantity is None:
            note = "being computed" if wanted.found is None else f"{note}; grey: no cord has room"
        else:
            note = f"{note}; range {_OWN if self._own(wanted) is not None else _ALL}; {_BEYOND}"
        return Picture(
            wanted,
            section,
            self.body.positions(section.at, section.points, wanted.state),
            scale.colors(numbers),
            color_bar(scale, wanted.look.title, wanted.look.unit, note),
        )

    def at_point(
        self, picture: Picture, triangle: int, weights: Float
    ) -> tuple[Float, Float, dict[str, float], float]:
        """Of a point of a section: its position at rest and in the state, its stretches by name,
        and the variance over all states of what is looked at (or else of the largest stretch)."""
        corners, wanted = picture.section.triangles[triangle], picture.wanted
        at = picture.section.at
        rest = weights @ picture.section.points[corners]
        where = LocatedPoints(at.cell[corners[:1]], (weights @ at.bary[corners])[None])
        direction = wanted.direction(rest[None])
        stretches = {
            name: float(self.body.values(where, Quantity(kind), wanted.state, direction)[0])
            for name, kind in _NAMES.items()
        }
        over = Quantity("along" if wanted.look.along else "largest", variance=True)
        variance = float(self.body.values(where, over, wanted.state, direction)[0])
        now = self.body.positions(where, rest[None], wanted.state)[0]
        return rest, now, stretches, variance

    def _numbers(self, wanted: Wanted, points: Float, at: LocatedPoints) -> Float:
        quantity, found = wanted.look.quantity, wanted.found
        if quantity is None:
            return np.full(len(points), np.nan) if found is None else nearest_drop(found, points)
        direction = wanted.direction(points)
        return wanted.look.numbers(self.body.values(at, quantity, wanted.state, direction))

    def _scale(self, wanted: Wanted) -> Scale:
        """While a hand moves the plane the range stays as it was."""
        if wanted.look.quantity is None:
            return Scale.gain(np.zeros(0) if wanted.found is None else wanted.found.drop)
        key = (wanted.look, self._own(wanted))
        if not (wanted.moving and key in self._scales):
            direction = wanted.direction(self.body.middles)
            reach = self.body.spread(wanted.look.quantity, key[1], direction)
            self._scales[key] = wanted.look.scale(reach)
        return self._scales[key]

    def _own(self, wanted: Wanted) -> int | None:
        """The state whose range it is, None for all; at rest there would be none."""
        return wanted.state if wanted.own_range and wanted.look.of_state and wanted.state else None


def nearest_drop(found: NextCord, points: Float) -> Float:
    """The drop (p,) at rest points (p, 3): that of the grid's point in whose square they lie; NaN
    where there is none."""
    if not len(found.points):
        return np.full(len(points), np.nan)
    away, which = cKDTree(found.points).query(points)
    return np.where(away <= found.step, found.drop[which], np.nan)
