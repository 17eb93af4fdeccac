"""Messages of the step Poses that change regions and poses."""

from __future__ import annotations

from typing import ClassVar

from ...workflow.view import Request, Result
from .poses import Role, ShapeKind, Turn


class RegionResult(Result, frozen=True, kw_only=True):
    """The region that was added or changed.

    Attributes:
        name: Its name.
        count: Number of surface points that it holds.
    """

    name: str
    count: int


class AddRegion(Request, frozen=True, kw_only=True):
    """Add a region at the middle of the body, or with given points and radius, mm."""

    result: ClassVar[type | None] = RegionResult

    shape: ShapeKind
    points: list[list[float]] | None = None
    radius: float = 0.0


class SetRegion(Request, frozen=True, kw_only=True):
    """Set the shape of a region; as `RegionState`."""

    result: ClassVar[type | None] = RegionResult

    region: str
    shape: ShapeKind
    points: list[list[float]]
    radius: float = 0.0


class FitRegion(Request, frozen=True, kw_only=True):
    """Fit a box about surface points.

    Attributes:
        region: The region that it replaces; empty for a new one.
        low: Smallest coordinates (3,) of the points, mm.
        high: Largest coordinates (3,), mm.
    """

    result: ClassVar[type | None] = RegionResult

    region: str
    low: list[float]
    high: list[float]


class ConvertRegion(Request, frozen=True, kw_only=True):
    """Replace a region by a box about its surface points."""

    result: ClassVar[type | None] = RegionResult

    region: str


class ShiftRegion(Request, frozen=True, kw_only=True):
    """Move a region by (3,) mm."""

    region: str
    by: list[float]


class DuplicateRegion(Request, frozen=True, kw_only=True):
    """Add a copy of a region, a little beside it."""

    result: ClassVar[type | None] = RegionResult

    region: str


class RenameRegion(Request, frozen=True, kw_only=True):
    """Rename a region, also in poses."""

    region: str
    name: str


class DeleteRegions(Request, frozen=True, kw_only=True):
    """Delete regions that no pose uses."""

    regions: list[str]


class PoseResult(Result, frozen=True, kw_only=True):
    """The pose that was added."""

    name: str


class AddPose(Request, frozen=True, kw_only=True):
    """Add a pose that holds one region and turns another."""

    result: ClassVar[type | None] = PoseResult


class DuplicatePose(Request, frozen=True, kw_only=True):
    """Add a copy of a pose."""

    result: ClassVar[type | None] = PoseResult

    pose: str


class RenamePose(Request, frozen=True, kw_only=True):
    """Rename a pose, also in mixed states."""

    pose: str
    name: str


class DeletePoses(Request, frozen=True, kw_only=True):
    """Delete poses, and the mixed states that contain them."""

    poses: list[str]


class SetRole(Request, frozen=True, kw_only=True):
    """Set what a pose does with a region.

    Attributes:
        center: Center (3,) of the region as shown, mm, where a region that is moved stays; None
            for its place at rest.
    """

    pose: str
    region: str
    role: Role
    center: list[float] | None = None


class SetTurn(Request, frozen=True, kw_only=True):
    """Set how a pose turns a region."""

    pose: str
    region: str
    turn: Turn
    axis: list[float]
    degrees: float


class SetShift(Request, frozen=True, kw_only=True):
    """Set the translation (3,) mm of a region; None is free."""

    pose: str
    region: str
    shift: list[float | None]


class SetPivot(Request, frozen=True, kw_only=True):
    """Set the point (3,) mm about which a region turns; None for its center."""

    pose: str
    region: str
    about: list[float] | None


class AddPull(Request, frozen=True, kw_only=True):
    """Pull at a point of the surface.

    Attributes:
        at: The point (3,) at rest, mm.
        normal: Direction (3,) of the pull.
    """

    pose: str
    at: list[float]
    normal: list[float]


class SetPull(Request, frozen=True, kw_only=True):
    """Change a pull; as `PullState`."""

    pose: str
    index: int
    at: list[float]
    by: list[float]
    stiffness: float


class DeletePull(Request, frozen=True, kw_only=True):
    """Delete a pull."""

    pose: str
    index: int


class SetPressure(Request, frozen=True, kw_only=True):
    """Set the pressure in a region, MPa; None removes it."""

    pose: str
    region: str
    value: float | None


class SetSymmetry(Request, frozen=True, kw_only=True):
    """Keep a region in a plane with a normal (3,); None releases it."""

    pose: str
    region: str
    normal: list[float] | None


class SetGravity(Request, frozen=True, kw_only=True):
    """Set gravity (3,) in multiples of standard gravity; zero removes it."""

    pose: str
    gravity: list[float]


class AddProposed(Request, frozen=True, kw_only=True):
    """Add proposed poses.

    Attributes:
        poses: Their names.
        has_states: Whether their mixed states are added as well.
    """

    result: ClassVar[type | None] = PoseResult

    poses: list[str]
    has_states: bool = False
