"""Messages of the step Sensors: edits of cords, and the error that is expected of them."""

from __future__ import annotations

from typing import ClassVar, Literal

from msgspec import field

from ...workflow.view import Event, Problem, Record, Request, Result


class PoseError(Record, frozen=True, kw_only=True):
    """What is expected in a pose at its largest level.

    Attributes:
        pose: Name of the pose.
        error: Error, mm.
        movement: Root mean square of the markers' movement, mm.
        travel: Largest movement of a marker, mm.
        grade: How good the error is for that movement, on the scale of `error_scale.py`.
        text: Error, share of the movement, and grade in words.
        signals: Relative change of resistance of each cord, (c,).
    """

    pose: str
    error: float
    movement: float
    travel: float
    grade: Literal["very good", "usable", "poor"]
    text: str
    signals: list[float]


class CordNumbers(Record, frozen=True, kw_only=True):
    """Measured numbers of a cord.

    Attributes:
        name: Name of the cord.
        length: Length with its inlets, mm.
        radius: Smallest radius of curvature, mm; None for a straight cord.
        wall: Smallest wall, mm.
    """

    name: str
    length: float
    radius: float | None
    wall: float


class Violation(Record, frozen=True, kw_only=True):
    """A limit that is broken.

    Attributes:
        code: Stable identifier of the limit.
        text: What is wrong, and how much is allowed.
        cords: Names of the cords that break it.
        at: Where (3,), mm.
    """

    code: str
    text: str
    cords: list[str]
    at: list[float]


class PartsCheck(Record, frozen=True, kw_only=True):
    """Whether the drawn cords can be made, and what they sense in their parts.

    Attributes:
        state: Whether that is not known, being checked, or known; "aborted" after an error of the
            check, which starts again after the next change.
        problem: Why they cannot be made.
        error: Expected error with the grooves of the parts, mm; None if it is not known.
        in_use: Error in use, mm: its median, and the limits of 90 % of built devices; empty if it
            is not known.
        parts: Number of parts.
    """

    state: Literal["none", "checking", "aborted", "passed", "failed"] = "none"
    problem: Violation | None = None
    error: float | None = None
    in_use: list[float] = field(default_factory=list)
    parts: int | None = None


class Judgement(Record, frozen=True, kw_only=True):
    """The error expected of cords, and the limits that they break.

    Attributes:
        error: Expected error, mm; None without cords, or if it cannot be predicted.
        decoder: The decoder.
        poses: Expectations by pose.
        cords: Numbers of the cords.
        violations: Broken limits.
        broken: Places (b, 3) where they are broken, mm.
    """

    error: float | None
    decoder: str
    poses: list[PoseError]
    cords: list[CordNumbers]
    violations: list[Violation]
    broken: list[list[float]]


class Prediction(Event, frozen=True, kw_only=True):
    """What is expected of the drawn cords and of those that were built.

    Attributes:
        is_ready: Whether the poses are simulated, so that errors can be predicted.
        text: What to do first, if they are not.
        is_computing: Whether `drawn` belongs to earlier cords, and is computed again.
        drawn: Judgement of the drawn cords; None if not ready.
        drawn_problem: Why it is missing.
        check: Whether they can be made.
        built: Error of the cords of the last build or search, mm; None without one.
        is_built_drawn: Whether those cords are the drawn ones.
        has_built_parts: Whether their parts were built, and not only their paths optimized.
    """

    is_ready: bool
    text: str
    is_computing: bool
    drawn: Judgement | None = None
    drawn_problem: Problem | None = None
    check: PartsCheck = field(default_factory=PartsCheck)
    built: float | None = None
    is_built_drawn: bool = False
    has_built_parts: bool = False


class DragResult(Result, frozen=True, kw_only=True):
    """A cord while it is dragged.

    Attributes:
        points: Its control points, snapped.
        tangents: Its tangents.
        path: Points (p, 3) along its path, mm.
        snapped_to: What the dragged point has snapped to, in words; empty for nothing.
        judgement: What is expected of all cords with it; None before the simulation.
        problem: Why no error can be predicted.
    """

    points: list[list[float]]
    tangents: list[list[float]]
    path: list[list[float]]
    snapped_to: str
    judgement: Judgement | None
    problem: Problem | None = None


class DragPoint(Request, frozen=True, kw_only=True):
    """Move a control point without writing it, and judge the cords.

    Attributes:
        cord: Name of the cord.
        index: Index of the control point.
        to: Position (2,) in the plane, or (3,) in space, mm.
        snap: Whether it snaps to the surface, the middle and other cords.
        write: Whether the drag has ended, and the cord is written.
    """

    result: ClassVar[type | None] = DragResult

    cord: str
    index: int
    to: list[float]
    snap: bool = True
    write: bool = False


class DragTangent(Request, frozen=True, kw_only=True):
    """Turn the tangent at a control point; as `DragPoint`, `to` is the tangent, mm."""

    result: ClassVar[type | None] = DragResult

    cord: str
    index: int
    to: list[float]
    write: bool = False


class DragPlane(Request, frozen=True, kw_only=True):
    """Move the plane of a cord.

    Attributes:
        origin: Origin (3,), mm.
        axes: x axis, y axis and normal, (3, 3) by rows.
    """

    result: ClassVar[type | None] = DragResult

    cord: str
    origin: list[float]
    axes: list[list[float]]
    write: bool = False


class InsertPoint(Request, frozen=True, kw_only=True):
    """Add a control point before the index `before`, at (2,) or (3,) mm."""

    cord: str
    before: int
    at: list[float]


class DeletePoint(Request, frozen=True, kw_only=True):
    """Delete a control point."""

    cord: str
    index: int


class SmoothCord(Request, frozen=True, kw_only=True):
    """Compute the tangents of a cord from its points, which move if a limit needs it."""

    cord: str


class RepairResult(Result, frozen=True, kw_only=True):
    """The cords that were moved so that they keep the limits.

    Attributes:
        cords: Names of the cords that moved.
        largest_move: How far a point of their paths moved at most, mm.
        remaining: Limits that are still broken, in words.
        is_complete: Whether all cords were tried before the time was over.
    """

    cords: list[str]
    largest_move: float
    remaining: list[str]
    is_complete: bool


class RepairCords(Request, frozen=True, kw_only=True):
    """Move cords as little as possible so that they keep all limits.

    Attributes:
        cords: Names of the cords that may move; empty for all.
    """

    result: ClassVar[type | None] = RepairResult
    lane: ClassVar[str] = "search"

    cords: list[str]


class RenameCord(Request, frozen=True, kw_only=True):
    """Rename a cord."""

    cord: str
    name: str


class DeleteCords(Request, frozen=True, kw_only=True):
    """Delete cords."""

    cords: list[str]


class CordResult(Result, frozen=True, kw_only=True):
    """The cord that was added."""

    name: str


class DuplicateCord(Request, frozen=True, kw_only=True):
    """Add a copy of a cord, a little beside it."""

    result: ClassVar[type | None] = CordResult

    cord: str


class MirrorCord(Request, frozen=True, kw_only=True):
    """Add a copy of a cord that is mirrored at the middle of the body, across an axis."""

    result: ClassVar[type | None] = CordResult

    cord: str
    axis: Literal["x", "y", "z"]


class SetFreedoms(Request, frozen=True, kw_only=True):
    """Set what the optimizer may change of a cord; nothing locks it."""

    cord: str
    free: list[Literal["path", "plane", "offset", "ends"]]


class AddStraight(Request, frozen=True, kw_only=True):
    """Add a straight cord along the middle of the body."""

    result: ClassVar[type | None] = CordResult


class ProposalResult(Result, frozen=True, kw_only=True):
    """The cord that was found and added.

    Attributes:
        name: Its name.
        error: Expected error with it, in the parts, mm.
        error_before: Expected error without it, in the parts, mm; None if it is the first cord.
    """

    name: str
    error: float | None
    error_before: float | None


class Propose(Request, frozen=True, kw_only=True):
    """Search for the cord that lowers the error most, and add it.

    Attributes:
        search: Number of the search among those of this browser.
    """

    result: ClassVar[type | None] = ProposalResult
    lane: ClassVar[str] = "search"

    search: int = 0


class CancelProposal(Request, frozen=True, kw_only=True):
    """End a search for another cord of this browser, also before it starts.

    Attributes:
        search: Its number.
    """

    search: int = 0


class ProposalProgress(Event, frozen=True, kw_only=True):
    """How far the search for another cord is.

    Attributes:
        share: Completed share, 0 to 1; None when no search runs.
    """

    share: float | None


class PlaneOutline(Result, frozen=True, kw_only=True):
    """The outline of the body in a plane.

    Attributes:
        segments: Segments (s, 2, 2) in the plane, mm.
        low: Smallest coordinates (3,) of the body, along the axes of the plane, mm.
        high: Largest coordinates (3,), mm.
    """

    segments: list[list[list[float]]]
    low: list[float]
    high: list[float]


class OutlineOf(Request, frozen=True, kw_only=True):
    """Cut the body's surface with a plane."""

    result: ClassVar[type | None] = PlaneOutline

    origin: list[float]
    axes: list[list[float]]


class AddStroke(Request, frozen=True, kw_only=True):
    """Add a cord along a stroke in a plane, or replace the path of a cord.

    Attributes:
        origin: Origin (3,) of the plane, mm.
        axes: x axis, y axis and normal, (3, 3) by rows.
        stroke: Points (n, 2) of the stroke in the plane, mm.
        replaces: Name of the cord whose path is replaced; empty for a new cord.
    """

    result: ClassVar[type | None] = CordResult

    origin: list[float]
    axes: list[list[float]]
    stroke: list[list[float]]
    replaces: str = ""


class Comparison(Result, frozen=True, kw_only=True):
    """Two cords next to each other; see `workflow.design.layout_judge.CordComparison`."""

    names: list[str]
    errors_without: list[float | None]
    error: float
    largest_signals: list[float]
    correlation: float
    is_redundant: bool


class CompareCords(Request, frozen=True, kw_only=True):
    """Compare two cords of the device."""

    result: ClassVar[type | None] = Comparison

    first: str
    second: str
