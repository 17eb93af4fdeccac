"""Messages of the step Make: the parts, their assembly, the lists of materials, and the export."""

from __future__ import annotations

from typing import ClassVar, Literal

from msgspec import field

from ...workflow.view import Event, Problem, Record, Request, Result

StepView = Literal["plates", "exploded", "cords", "joint", "assembled"]


class MakeState(Event, frozen=True, kw_only=True):
    """Which version of the device the parts belong to.

    Attributes:
        code: Whether parts are built, belong to an earlier device, were built with other options,
            or are up to date.
        text: The same in a sentence.
        detail: What has changed, or what to do, in a second sentence; may be empty.
        build_obstacle: Why the parts cannot be built; empty if they can.
        export_obstacle: Why there is nothing to export; empty if there is.
        problem: Why the last build failed, or None.
        cords: Which cords the parts contain, in a sentence; empty without parts.
        are_cords_drawn: Whether Sensors shows these cords.
        error: Expected error of the parts, mm; None without parts.
        in_use: Their error in use, mm, and the limits of 90 % of built devices, (3,); empty without
            parts.
    """

    code: Literal["not-built", "outdated", "other-options", "up-to-date"]
    text: str
    detail: str
    build_obstacle: str
    export_obstacle: str
    problem: Problem | None = None
    cords: str = ""
    are_cords_drawn: bool = True
    error: float | None = None
    in_use: list[float] = field(default_factory=list)


class PartState(Record, frozen=True, kw_only=True):
    """A part of the device.

    Attributes:
        name: Its name, which starts with its number.
        color: Its color in the guide, "#rrggbb".
        volume: Volume, mm^3.
        size: Extent along the axes of the device (3,), mm.
        plate: File of the plate that it is printed on; empty if it is cast.
        shift: Displacement (3,) mm in the exploded view.
    """

    name: str
    color: str
    volume: float
    size: list[float]
    plate: str
    shift: list[float]


class Parts(Event, frozen=True, kw_only=True):
    """The parts of the last build.

    Attributes:
        id: Identifier of the build's parts; empty without parts.
        parts: The parts.
    """

    id: str
    parts: list[PartState]


class BuiltCordState(Record, frozen=True, kw_only=True):
    """A cord as it is built in.

    Attributes:
        name: Name of the cord.
        color: Its color, "#rrggbb".
        path: Points (p, 3), mm.
    """

    name: str
    color: str
    path: list[list[float]]


class GuidePin(Record, frozen=True, kw_only=True):
    """A pin of a joint.

    Attributes:
        letter: Letter by which the text names it.
        start: One end (3,), mm.
        end: The other end (3,), mm.
        radius: Radius, mm.
    """

    letter: str
    start: list[float]
    end: list[float]
    radius: float


class GuideJoint(Record, frozen=True, kw_only=True):
    """The joint that a step closes.

    Attributes:
        lower: Names of the parts on the table.
        upper: Names of the parts that are lifted.
        lift: Displacement (3,) of the lifted parts in the open joint, mm.
        wires: Lines (p, 3) of the wires, mm.
        glueless: Lines (p, 3) mm that bound where no glue may be: along grooves, and rings.
        pins: The pins.
    """

    lower: list[str]
    upper: list[str]
    lift: list[float]
    wires: list[list[list[float]]]
    glueless: list[list[list[float]]]
    pins: list[GuidePin]


class GuideStage(Record, frozen=True, kw_only=True):
    """A step of the assembly.

    Attributes:
        id: Identifier of its content; the steps that are done are kept by it.
        title: Its title.
        passages: Instructions, in passages.
        view: What the picture shows.
        cords: Names of the cords in the picture.
        joint: The joint that it closes, or None.
    """

    id: str
    title: str
    passages: list[list[str]]
    view: StepView
    cords: list[str]
    joint: GuideJoint | None = None


class GuideList(Record, frozen=True, kw_only=True):
    """A table of texts.

    Attributes:
        title: Its title.
        header: Headings of the columns.
        rows: Rows with as many texts.
    """

    title: str
    header: list[str]
    rows: list[list[str]]


class GuideNote(Record, frozen=True, kw_only=True):
    """A warning.

    Attributes:
        text: The warning.
        point: Where it applies (3,), mm; None for the whole device.
    """

    text: str
    point: list[float] | None


class MadeFile(Record, frozen=True, kw_only=True):
    """A file of the build that can be saved.

    Attributes:
        title: What it is.
        name: Its name.
        path: Its address on this server.
        size: Its size in bytes.
    """

    title: str
    name: str
    path: str
    size: int


class Guide(Event, frozen=True, kw_only=True):
    """How the parts of the last build are assembled.

    Attributes:
        id: Identifier of the build's parts; empty without parts.
        cord_radius: Radius of the cords, mm.
        wire_radius: Radius of the wires, mm.
        cords: The cords as built in.
        stages: The steps, in order.
        lists: What to print, to cut and to buy.
        checks: Measurements of the parts with their limits.
        notes: Warnings.
        files: Files of the build.
    """

    id: str
    cord_radius: float
    wire_radius: float
    cords: list[BuiltCordState]
    stages: list[GuideStage]
    lists: list[GuideList]
    checks: GuideList | None
    notes: list[GuideNote]
    files: list[MadeFile]


class AssemblyProgress(Event, frozen=True, kw_only=True):
    """The steps of the assembly that are done, by their identifiers."""

    done: list[str]


class TickStage(Request, frozen=True, kw_only=True):
    """Mark a step of the assembly as done, or as not done."""

    stage: str
    is_done: bool


class PartMeshes(Request, frozen=True, kw_only=True):
    """Get the surfaces of the parts.

    It is answered with the arrays `<k>/vertices` (v, 3) mm, `<k>/faces` (f, 3) and `<k>/edges`
    (e, 2) of each part k, and with the facts `id` and `names`.
    """

    lane: ClassVar[str] = "parts"


class ExportResult(Result, frozen=True, kw_only=True):
    """The zip of the built device.

    Attributes:
        file: The zip.
        count: Number of files in it.
    """

    file: MadeFile
    count: int


class ExportDevice(Request, frozen=True, kw_only=True):
    """Write the parts, the guide, the report and the design into a zip in the device's folder."""

    result: ClassVar[type | None] = ExportResult
    lane: ClassVar[str] = "export"
