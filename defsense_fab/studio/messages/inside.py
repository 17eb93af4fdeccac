"""Messages of the step Inside: sections through the body, and the place of another cord."""

from __future__ import annotations

from typing import ClassVar, Literal

import msgspec

from ...workflow.view import Event, Problem, Record, Request, Result
from .sensors import CordResult

#: Quantities that a section shows; "next-cord" is the benefit of another cord.
QuantityName = Literal[
    "along", "largest", "smallest", "deviation-along", "deviation-largest", "next-cord"
]


class ColorMap(Record, frozen=True, kw_only=True):
    """Colors of numbers.

    Attributes:
        name: Name of the map.
        colors: Colors (k, 3), 0 to 255, at equal distances.
        is_diverging: Whether the middle color is that of zero, and both ends are equally far from
            it; otherwise the map extends from the lower end of a range to its upper end.
    """

    name: str
    colors: list[list[int]]
    is_diverging: bool


class QuantityInfo(Record, frozen=True, kw_only=True):
    """A quantity that a section shows.

    Attributes:
        name: The quantity.
        label: What it is called.
        hint: What it means.
        unit: Unit of its numbers.
        color_map: Name of its color map.
        needs_direction: Whether it depends on a direction.
        varies_by_state: Whether it differs from state to state.
    """

    name: QuantityName
    label: str
    hint: str
    unit: str
    color_map: str
    needs_direction: bool
    varies_by_state: bool


class StateInfo(Record, frozen=True, kw_only=True):
    """A simulated state.

    Attributes:
        name: Name of the state.
        label: What it is called, such as "bend 50 %".
    """

    name: str
    label: str


class InsideState(Event, frozen=True, kw_only=True):
    """What sections of the body can show.

    Attributes:
        is_ready: Whether the poses are simulated.
        text: What to do first, if they are not.
        revision: Number of the simulation; skins and shapes belong to one.
        states: The states, rest first; empty if not ready.
        first_state: Index of the state to show first.
        origin: Origin (3,) of the plane to show first, mm.
        axes: Its x axis, y axis and normal, (3, 3) by rows.
        middle: Middle (3,) of the body, from which offsets of planes are measured, mm.
        size: Largest extent of the body, mm.
        short_cord: Length of a short cord, mm.
        quantities: The quantities.
        color_maps: The color maps.
        unknown_color: Color (3,) where a quantity is unknown, 0 to 255.
    """

    is_ready: bool
    text: str
    revision: int
    states: list[StateInfo]
    first_state: int
    origin: list[float]
    axes: list[list[float]]
    middle: list[float]
    size: float
    short_cord: float
    quantities: list[QuantityInfo]
    color_maps: list[ColorMap]
    unknown_color: list[int]


class GetSkin(Request, frozen=True, kw_only=True):
    """Get the simulated body's surface at rest.

    The answer has the arrays `rest` (v, 3) mm, `faces` (f, 3) and `edges` (e, 2), and the fact
    `revision`.
    """

    lane: ClassVar[str] = "section"


class GetShape(Request, frozen=True, kw_only=True):
    """Get the surface and the cords in a state.

    The answer has the arrays `vertices` (v, 3) mm and `cords` (n, 3) mm, the points of all cords
    in the device's order, and the facts `revision` and `counts`, the number of points of each cord.

    Attributes:
        state: Index of the state.
    """

    lane: ClassVar[str] = "section"

    state: int


class ShowSection(Request, frozen=True, kw_only=True):
    """Cut the body with a plane.

    The answer has the arrays `vertices` (v, 3) mm in the state, `rest` (v, 3) mm at rest,
    `triangles` (t, 3) and `values` (v,), NaN where unknown; and the facts `low`, `high` and `step`
    of the color bar, `smallest` and `largest` value of the section or null, and `lowest` and
    `highest` offset of the plane from the body's middle that meets the body, mm.

    Attributes:
        origin: Origin (3,) of the plane in the body at rest, mm.
        axes: Its x axis, y axis and normal, (3, 3) by rows.
        state: Index of the state.
        quantity: The quantity.
        angle: Direction in the plane, degrees from its x axis.
        cord: Name of a cord whose local direction replaces the angle; empty for none.
        detail: "coarse" while the plane is dragged.
        is_range_fixed: Whether the color bar is the same for all states and planes.
    """

    lane: ClassVar[str] = "section"

    origin: list[float]
    axes: list[list[float]]
    state: int
    quantity: QuantityName
    angle: float = 0.0
    cord: str = ""
    detail: Literal["coarse", "fine"] = "fine"
    is_range_fixed: bool = False


class PointNumbers(Result, frozen=True, kw_only=True):
    """Numbers of a point of the body.

    Attributes:
        rest: Position at rest (3,), mm.
        position: Position in the state (3,), mm.
        along: Strain along the direction, percent.
        largest: Largest principal strain, percent.
        smallest: Smallest principal strain, percent.
        deviation: Standard deviation of the strain over all states, percent.
        drop: Decrease of the expected error by a cord here, mm; None if unknown.
    """

    rest: list[float]
    position: list[float]
    along: float
    largest: float
    smallest: float
    deviation: float
    drop: float | None


class ProbePoint(Request, frozen=True, kw_only=True):
    """Get the numbers of a point; see `ShowSection` for the other attributes.

    Attributes:
        at: The point at rest (3,), mm.
    """

    result: ClassVar[type | None] = PointNumbers
    lane: ClassVar[str] = "section"

    at: list[float]
    origin: list[float]
    axes: list[list[float]]
    state: int
    quantity: QuantityName
    angle: float = 0.0
    cord: str = ""


class SearchNextCord(Request, frozen=True, kw_only=True):
    """Search in a plane for the best place of another cord.

    It replaces a running search. `NextCordState` follows, and arrays named "next-cord" when a map
    is found: `points` (p, 3) mm, `drop` (p,) mm, NaN where no cord fits, and `ends` (p, 2, 3) mm of
    the best cord through each point; with the fact `step`, the distance of the points in mm.

    Attributes:
        origin: Origin (3,) of the plane, mm.
        axes: Its x axis, y axis and normal, (3, 3) by rows.
        length: Length of the cord, mm; None for cords from surface to surface.
    """

    lane: ClassVar[str] = "section"

    origin: list[float]
    axes: list[list[float]]
    length: float | None = None


class StopNextCord(Request, frozen=True, kw_only=True):
    """Cancel the search, and forget its map.

    Attributes:
        keeps_map: Whether a map that was found is kept.
    """

    lane: ClassVar[str] = "section"

    keeps_map: bool = False


class AddNextCord(Request, frozen=True, kw_only=True):
    """Add a cord of the map to the device.

    Attributes:
        at: Point (3,) that the cord runs through, mm; None for the best cord.
    """

    result: ClassVar[type | None] = CordResult

    at: list[float] | None = None


class NextCordState(Event, frozen=True, kw_only=True):
    """What the search of this browser does, or has found.

    Attributes:
        state: "outdated" after a change of the cords or of the simulation.
        share: Completed share, 0 to 1.
        problem: Why it has failed.
        has_map: Whether a map is known; a coarse one is, while the fine one is searched.
        length: Length of the cords, mm; None from surface to surface.
        tried: Number of cords that were tried.
        error: Expected error of the present cords, mm.
        drop: Decrease of the error by the best cord, mm; 0 if none lowers it.
        ends: Ends (2, 3) of the best cord, mm; empty if none lowers the error.
    """

    state: Literal["none", "searching", "found", "canceled", "outdated", "failed"]
    share: float = 0.0
    problem: Problem | None = None
    has_map: bool = False
    length: float | None = None
    tried: int = 0
    error: float = 0.0
    drop: float = 0.0
    ends: list[list[float]] = msgspec.field(default_factory=list)
