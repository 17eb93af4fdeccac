"""Messages of the step Poses: regions, poses, their shapes while they are changed, and states.

Arrays that belong to these messages:

- "pose-body": vertices (v, 3) mm at rest, faces and edges of the meshed body, for everyone.
- "pose-pictures": displacements (v, 3) mm of each pose by its index, for everyone; the facts name
  the poses.
- "proposed-poses": displacements (v, 3) mm of each proposed pose by its index, for everyone.
- "pose-shape": vertices (v, 3) mm of the pose that one browser shows; `PoseShape` follows.
"""

from __future__ import annotations

from typing import ClassVar, Literal

from ...workflow.view import Event, Record, Request

ShapeKind = Literal["box", "sphere", "half-space", "cylinder"]
Role = Literal["free", "held", "turned", "moved"]
Turn = Literal["angle", "hinge", "free"]
ShapePhase = Literal[
    "solving", "coarse", "solved", "checked", "canceled", "not-reached", "invalid", "failed"
]


class RegionState(Record, frozen=True, kw_only=True):
    """A region of the device.

    Attributes:
        name: Name of the region.
        color: Its color, "#rrggbb".
        shape: Kind of the shape.
        points: Corners of a box, center of a sphere, origin and normal of a half space, or start
            and end of a cylinder, each (3,), mm.
        radius: Radius of a sphere or cylinder, mm; 0 otherwise.
        center: Middle (3,) of its surface points, mm.
        count: Number of surface points; 0 while the body has no mesh.
        problems: What is wrong with it.
        poses: Names of the poses that use it.
    """

    name: str
    color: str
    shape: ShapeKind
    points: list[list[float]]
    radius: float
    center: list[float]
    count: int
    problems: list[str]
    poses: list[str]


class HandleState(Record, frozen=True, kw_only=True):
    """A region that a pose moves.

    Attributes:
        region: Name of the region.
        turn: How it turns.
        axis: Unit axis (3,) of the rotation.
        degrees: The angle; 0 where it is free.
        shift: Translation (3,) mm; None in free components.
        about: Pivot (3,) mm; None for the region's center.
        center: Point (3,) at rest about which it turns, mm.
    """

    region: str
    turn: Turn
    axis: list[float]
    degrees: float
    shift: list[float | None]
    about: list[float] | None
    center: list[float]


class PullState(Record, frozen=True, kw_only=True):
    """A spring that pulls at a point (3,) mm by (3,) mm, with its stiffness, N/mm."""

    at: list[float]
    by: list[float]
    stiffness: float


class PressureState(Record, frozen=True, kw_only=True):
    """A pressure in a region, MPa; positive pushes inward."""

    region: str
    value: float


class SymmetryState(Record, frozen=True, kw_only=True):
    """A region whose points stay in a plane with a normal (3,)."""

    region: str
    normal: list[float]


class PoseWarning(Record, frozen=True, kw_only=True):
    """What is wrong with a pose as it was solved last.

    Attributes:
        code: Stable identifier, such as "pose-not-reached".
        text: What is wrong and what to do.
        share: Share of the ramp that was reached.
    """

    code: str
    text: str
    share: float


class PoseState(Record, frozen=True, kw_only=True):
    """A pose of the device.

    Attributes:
        name: Name of the pose.
        roles: What it does with each region, in the order of the regions.
        handles: Regions that it moves.
        pulls: Points that it pulls.
        pressures: Pressures.
        symmetry: Regions that stay in their plane.
        gravity: Gravity (3,), in multiples of standard gravity.
        picture: Digest of everything that its shape follows from.
        warning: What is wrong with it, or None.
    """

    name: str
    roles: list[Role]
    handles: list[HandleState]
    pulls: list[PullState]
    pressures: list[PressureState]
    symmetry: list[SymmetryState]
    gravity: list[float]
    picture: str
    warning: PoseWarning | None = None


class PosesState(Event, frozen=True, kw_only=True):
    """The regions and poses of the device.

    Attributes:
        mesh: Whether the body has a mesh, and whether it belongs to the present body.
        size: Largest extent of the body, mm.
        regions: The regions.
        poses: The poses.
    """

    mesh: Literal["missing", "old", "current"]
    size: float
    regions: list[RegionState]
    poses: list[PoseState]


class HeldForce(Record, frozen=True, kw_only=True):
    """The force at one place in the state that needs the most.

    Attributes:
        place: The moved region, or the point that is pulled.
        push: Force along the movement, N.
        torque: Moment, N m.
    """

    place: str
    push: float
    torque: float


class SimulatedState(Record, frozen=True, kw_only=True):
    """A state of the last simulation.

    Attributes:
        name: Name of the state, such as "bend@0.5".
        weights: Amplitude of each pose.
        is_held_out: Whether it is held out of the design.
        problem: What the solver reports, unless it succeeded; empty if it did.
    """

    name: str
    weights: dict[str, float]
    is_held_out: bool
    problem: str


class PoseForces(Record, frozen=True, kw_only=True):
    """The forces that hold the device in a pose, at its largest state.

    Attributes:
        pose: Name of the pose.
        state: Name of the state.
        held: Forces at everything that the pose moves.
        effort: What holding the pose needs: fingers, a whole hand, or more than one hand can do.
        warning: What is too hard for fingers or for a hand; empty if nothing is.
    """

    pose: str
    state: str
    held: list[HeldForce]
    effort: Literal["fingers", "hand", "beyond"]
    warning: str


class SimulatedStates(Event, frozen=True, kw_only=True):
    """The states of the last simulation.

    Attributes:
        is_current: Whether they belong to the present body and poses.
        levels: Shares of each pose that are simulated.
        states: The states; none before the simulation.
        forces: Forces of each pose; none until they are known.
        warnings: Warnings of the simulation.
    """

    is_current: bool
    levels: list[float]
    states: list[SimulatedState]
    forces: list[PoseForces]
    warnings: list[str]


class ProposedPose(Record, frozen=True, kw_only=True):
    """A pose that follows a vibration mode.

    Attributes:
        name: Name that it is proposed with.
        frequency: Frequency of the mode, Hz.
    """

    name: str
    frequency: float


class ProposedPoses(Event, frozen=True, kw_only=True):
    """Poses of the last search; none before a search, or for another mesh.

    Attributes:
        held: Region that holds the body; empty before a search.
        poses: The poses.
        notes: Poses that were weakened or left out, and why.
    """

    held: str
    poses: list[ProposedPose]
    notes: list[str]


class PosePictures(Event, frozen=True, kw_only=True):
    """Whether shapes for small pictures of poses are being computed."""

    is_computing: bool


class PoseShape(Event, frozen=True, kw_only=True):
    """The shape that one browser shows; its arrays "pose-shape" were sent before.

    Attributes:
        pose: Name of the pose.
        phase: "coarse" while the fine shape follows; "checked" as a build simulates it.
        share: Share of the pose's ramp that was requested.
        text: What is wrong; empty for nothing. Then the last shape stays.
        centers: Centers (3,) mm of moved regions, by region; none for coarse shapes.
    """

    pose: str
    phase: ShapePhase
    share: float
    text: str
    centers: dict[str, list[float]]


class ShowPose(Request, frozen=True, kw_only=True):
    """Solve a pose for this browser, and follow its changes until another pose is shown.

    Attributes:
        share: Share of the pose's ramp.
    """

    pose: str
    share: float = 1.0


class HidePose(Request, frozen=True, kw_only=True):
    """Stop to follow the pose that this browser shows."""


class StopSolving(Request, frozen=True, kw_only=True):
    """Cancel the solver and keep the last shape."""

    lane: ClassVar[str] = "stop"


class MoveGrip(Request, frozen=True, kw_only=True):
    """Move a region or a pulled point of the shown pose, and solve the pose.

    Attributes:
        region: The moved region; empty for a pull.
        pull: Index of the pull; -1 for a region.
        position: Position (3,) of the region's center or of the pull's goal, mm.
        rotation: Rotation vector (3,) of the region, rad.
        write: Whether the drag has ended, and the pose is written.
    """

    pose: str
    region: str
    pull: int
    position: list[float]
    rotation: list[float]
    write: bool = False


class FollowRamp(Request, frozen=True, kw_only=True):
    """Solve a pose from rest along its ramp; answered by the arrays "pose-ramp".

    Its frames (f, v, 3) mm are displacements at equal shares from rest to the fact `end`. The fact
    `remark` is what there is to say; `isSimulated` is whether a build simulated them.
    """

    lane: ClassVar[str] = "ramp"

    pose: str


class StateShape(Request, frozen=True, kw_only=True):
    """Read a simulated state; answered by the arrays "state-shape" with displacements (v, 3) mm."""

    lane: ClassVar[str] = "files"

    state: str


class ProposePoses(Request, frozen=True, kw_only=True):
    """Search in the background for poses of the body that a region holds."""

    held: str
