"""Messages about the whole page: the device, its steps, undo, the running job and notices."""

from __future__ import annotations

from typing import ClassVar, Literal

from ...workflow.view import Event, Problem, Record, Request

StepName = Literal["body", "poses", "inside", "sensors", "optimize", "make", "measure"]
StepState = Literal["done", "stale", "ready", "blocked"]
Stage = Literal["mesh", "simulate", "optimize", "report"]


class Page(Event, frozen=True, kw_only=True):
    """Which page is shown.

    Attributes:
        screen: The start page, the page of a device, or that of a device that cannot be read.
        folder: The device's folder.
        problem: Why the device cannot be read, or why its file is not followed, or None.
        version: Version of this program.
    """

    screen: Literal["start", "device", "broken"]
    folder: str
    problem: Problem | None = None
    version: str


class CordState(Record, frozen=True, kw_only=True):
    """A cord of the device.

    Attributes:
        name: Name of the cord.
        color: Its color, "#rrggbb".
        is_planar: Whether its path lies in a plane.
        origin: Origin (3,) of the plane, mm.
        axes: The plane's x axis, y axis and normal, (3, 3) by rows.
        points: Control points (k, 2) in the plane, or (k, 3) in space, mm.
        tangents: Tangents of the same shape, mm.
        is_smooth: Whether the tangents follow from the points.
        path: Points (p, 3) along the path in the rest frame, mm.
        free: What the optimizer may change; nothing for a locked cord.
    """

    name: str
    color: str
    is_planar: bool
    origin: list[float]
    axes: list[list[float]]
    points: list[list[float]]
    tangents: list[list[float]]
    is_smooth: bool
    path: list[list[float]]
    free: list[str]


class DeviceState(Event, frozen=True, kw_only=True):
    """The device as it is now.

    Attributes:
        name: Name of the device.
        undo_name: Name of the edit that Undo reverts; empty for none.
        redo_name: Name of the edit that Redo repeats; empty for none.
        noun: What one sensor is called: "cord" or "trace".
        cord_radius: Radius of the cords, mm.
        cords: The cords.
        regions: Names of the regions.
        poses: Names of the poses.
    """

    name: str
    undo_name: str
    redo_name: str
    noun: str
    cord_radius: float
    cords: list[CordState]
    regions: list[str]
    poses: list[str]


class StepStatus(Record, frozen=True, kw_only=True):
    """One step of the work.

    Attributes:
        name: The step.
        state: "done", "stale" if something before it has changed, "ready" to be done, or "blocked"
            by an earlier step.
        text: Why, in one sentence.
    """

    name: StepName
    state: StepState
    text: str


class NextAction(Record, frozen=True, kw_only=True):
    """What to do next.

    Attributes:
        label: Label of the button.
        hint: What it does.
        step: The step that it belongs to.
        stage: The stage that it builds; None if it only opens the step.
        cord: The cord whose broken limit it shows; empty for none.
    """

    label: str
    hint: str
    step: StepName
    stage: Stage | None = None
    cord: str = ""


class Pipeline(Event, frozen=True, kw_only=True):
    """The steps of the work, and what to do next."""

    steps: list[StepStatus]
    next: NextAction


class Job(Event, frozen=True, kw_only=True):
    """The work in the background, or the last one that has ended.

    Attributes:
        name: What runs, such as "build".
        title: What is done, such as "Optimize the cords"; empty before the first job.
        state: What it does now.
        share: Completed share, 0 to 1.
        message: What it does now, in words.
        can_pause: Whether it can be paused.
        gives_way: Whether it is canceled when another job is started.
        problem: Why it failed, or None.
    """

    name: str
    title: str
    state: Literal["idle", "running", "paused"]
    share: float = 0.0
    message: str = ""
    can_pause: bool = False
    gives_way: bool = False
    problem: Problem | None = None


class Notice(Event, frozen=True, kw_only=True):
    """A short message that is shown for some seconds.

    Attributes:
        text: The message.
        problem: The error that it reports, or None.
    """

    is_kept: ClassVar[bool] = False

    text: str
    problem: Problem | None = None


class ScriptFile(Record, frozen=True, kw_only=True):
    """A file that would run.

    Attributes:
        name: Its name.
        text: Its content; empty for machine code.
        size: Its size in bytes.
    """

    name: str
    text: str
    size: int


class Question(Event, frozen=True, kw_only=True):
    """The question whether the body's script may run.

    Attributes:
        path: The script; empty if no answer is awaited.
        files: All code that would run.
    """

    path: str
    files: list[ScriptFile]


class Answer(Request, frozen=True, kw_only=True):
    """The answer to the question."""

    run: bool


class Undo(Request, frozen=True, kw_only=True):
    """Undo the last edit."""


class Redo(Request, frozen=True, kw_only=True):
    """Repeat the edit that was undone last."""


class Restore(Request, frozen=True, kw_only=True):
    """Replace a device file that cannot be read by the last valid one."""


class RenameDevice(Request, frozen=True, kw_only=True):
    """Rename the device."""

    name: str


class StartBuild(Request, frozen=True, kw_only=True):
    """Build the device up to a stage in the background.

    Building the parts is refused with the code "cords-undecided" if the build would move the drawn
    cords.

    Attributes:
        stage: The stage.
        cords: Whether the drawn cords are built as they are, and locked for it.
    """

    stage: Stage
    cords: Literal["ask", "as-drawn"] = "ask"


class PauseJob(Request, frozen=True, kw_only=True):
    """Pause the job."""


class ResumeJob(Request, frozen=True, kw_only=True):
    """Continue the job after a pause."""


class CancelJob(Request, frozen=True, kw_only=True):
    """Cancel the job."""
