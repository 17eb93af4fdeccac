"""Messages of the step Optimize: the search, layouts side by side, and the error on the surface."""

from __future__ import annotations

from typing import ClassVar, Literal

from msgspec import field

from ...workflow.view import Event, Record, Request

Standing = Literal[
    "not-ready", "never-searched", "locked", "searching", "optimized", "drawn-differ", "outdated"
]
Role = Literal["drawn", "built", "candidate", "straight", "studied", "earlier"]


class GhostCord(Record, frozen=True, kw_only=True):
    """A cord that is shown and does not belong to the device.

    Attributes:
        name: Name of the cord.
        path: Points (p, 3) along its path, mm.
    """

    name: str
    path: list[list[float]]


class OptimizeState(Event, frozen=True, kw_only=True):
    """What is true of the drawn and of the optimized cords.

    Attributes:
        standing: What the sentence says: nothing can be searched yet, no search has moved the
            drawn cords, all are locked, a search runs, the drawn cords are the optimized ones,
            they differ from them, or the body, the poses or the material have changed since.
        text: The sentence.
        obstacle: Why no search can start, or why it would find the same; empty if one can.
        drawn: Expected error of the drawn cords, mm; None if it cannot be predicted.
        is_drawn_in_parts: Whether this is the error in their parts; else it is that without the
            cuts, as their parts were not made on trial or cannot be made.
        built: Expected error of the cords of the last build or search, mm; None without one.
        is_built_moved: Whether a search has moved or added those.
        best_layout: Name of the layout to use after a search: the chosen one, or the most accurate
            that can be made; empty for none.
        best_problem: Why none can be made; empty if one can.
    """

    standing: Standing
    text: str
    obstacle: str
    drawn: float | None = None
    is_drawn_in_parts: bool = False
    built: float | None = None
    is_built_moved: bool = False
    best_layout: str = ""
    best_problem: str = ""


class SearchedPose(Record, frozen=True, kw_only=True):
    """The error in a pose at its largest level.

    Attributes:
        pose: Name of the pose.
        drawn: Error of the drawn cords, mm; None if it cannot be predicted.
        best: Error of the best cords of the search, mm; None before they are found.
    """

    pose: str
    drawn: float | None
    best: float | None


class Search(Event, frozen=True, kw_only=True):
    """The search of this session, while it runs and after it.

    Attributes:
        state: Whether a search has started, runs or has ended.
        times: Time of work of each layout that it has come to (n,), s.
        currents: Error of these layouts (n,), mm.
        bests: Error of the best layout until then (n,), mm; None before there is one.
        drawn: Error of the drawn cords, mm; None if it cannot be predicted.
        best: Error of the best layout that keeps all limits, mm; None before there is one.
        poses: Errors by pose.
        current_cords: The layout that it has come to; empty after its end.
        best_cords: The best layout.
    """

    state: Literal["none", "running", "ended"]
    times: list[float] = field(default_factory=list)
    currents: list[float] = field(default_factory=list)
    bests: list[float | None] = field(default_factory=list)
    drawn: float | None = None
    best: float | None = None
    poses: list[SearchedPose] = field(default_factory=list)
    current_cords: list[GhostCord] = field(default_factory=list)
    best_cords: list[GhostCord] = field(default_factory=list)


class LayoutRow(Record, frozen=True, kw_only=True):
    """A layout next to others. Numbers that are not computed are None.

    Attributes:
        name: Unique name of the layout.
        role: Which layout it is; the numbers of an earlier one are of an earlier design.
        is_drawn: Whether the drawn cords are those of the layout.
        error: Expected error in its parts if `parts` is known, else without the cuts, mm.
        drawn_error: Expected error without the cuts of the parts, mm.
        trained: Error expected after training, with the memory of the cords, mm.
        trained_low: Lower limit of the range of 90 % of built devices, mm.
        trained_high: Upper limit of this range, mm.
        parts: Number of parts.
        print_hours: Estimated time to print them, h.
        length: Length of all cords with their inlets, mm.
        planes: Number of planes that the body is cut along.
        cords: The cords.
        notes: Warnings about its parts.
        problem: Why it cannot be made; empty if it can.
    """

    name: str
    role: Role
    is_drawn: bool
    error: float | None
    drawn_error: float | None
    trained: float | None
    trained_low: float | None
    trained_high: float | None
    parts: int | None
    print_hours: float | None
    length: float | None
    planes: int
    cords: list[GhostCord]
    notes: list[str]
    problem: str


class Layouts(Event, frozen=True, kw_only=True):
    """The layouts side by side, the drawn one first, the others by increasing error.

    Attributes:
        rows: The layouts.
        compare_seconds: Estimated time to compute the missing numbers, s; 0 if none is missing.
        obstacle: Why the missing numbers cannot be computed; empty if they can.
    """

    rows: list[LayoutRow]
    compare_seconds: int
    obstacle: str


class MappedState(Record, frozen=True, kw_only=True):
    """A state whose error is shown on the surface.

    Attributes:
        name: Name of the state.
        expected: Error at the markers with noise, mm.
        is_held_out: Whether the layout was optimized without it.
    """

    name: str
    expected: float
    is_held_out: bool


class ErrorStates(Event, frozen=True, kw_only=True):
    """The states of the last build whose error can be shown on the surface."""

    states: list[MappedState]


class ErrorMapOf(Request, frozen=True, kw_only=True):
    """Compute the error on the surface in a state.

    It is answered with the arrays `rest` (v, 3) mm, `moved` (v, 3) mm, `faces` (f, 3), `edges`
    (e, 2) and `error` (v,) mm, and with the facts `mean`, `largest` and `high`, the end of the
    scale of all states, in mm.

    Attributes:
        state: Name of the state.
    """

    lane: ClassVar[str] = "error-map"

    state: str


class UseLayout(Request, frozen=True, kw_only=True):
    """Replace the drawn cords by those of a layout."""

    name: str


class UseBest(Request, frozen=True, kw_only=True):
    """End the search if it runs, and replace the drawn cords by its best ones that can be made."""

    lane: ClassVar[str] = "search"


class UnlockCords(Request, frozen=True, kw_only=True):
    """Let the search move all cords."""


class CompareLayouts(Request, frozen=True, kw_only=True):
    """Compute the missing numbers of the layouts in the background."""
