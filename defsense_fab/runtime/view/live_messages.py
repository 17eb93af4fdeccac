"""Messages of the live view and of guided runs, for the studio and for pages of their own."""

from __future__ import annotations

from typing import ClassVar, Literal

from msgspec import field

from .messages import Event, Record, Request, Result

#: Names of the arrays of a running device: at rest, and of its newest frame.
DEVICE_ARRAYS, FRAME_ARRAYS = "live-device", "live-frame"


class LivePage(Event, frozen=True, kw_only=True):
    """Which page is shown, if it is not the studio.

    Attributes:
        screen: The live view, or a guided run.
        title: Title of the page.
    """

    screen: Literal["live", "guided"]
    title: str


class LiveDevice(Event, frozen=True, kw_only=True):
    """The device that runs live; its surface and cords at rest follow as arrays.

    Attributes:
        name: Name of the device; empty if none runs.
        channels: Names of the c channels.
        low: Smallest signals in the training (c,).
        high: Largest signals in the training (c,).
        marker_radius: Typical radius of the markers' 90 % intervals, mm.
        cord_radius: Radius of the cords, mm.
        has_surface: Whether there is a surface, or only markers.
        can_take_rest: Whether the present readings can be taken as those at rest.
        can_record: Whether animations can be recorded.
        poses: Names of the poses that a simulated device can be bent by; empty for a real one.
    """

    name: str
    channels: list[str]
    low: list[float]
    high: list[float]
    marker_radius: float
    cord_radius: float
    has_surface: bool
    can_take_rest: bool
    can_record: bool
    poses: list[str]


class LiveNotes(Event, frozen=True, kw_only=True):
    """What the user should know about the run, a few times a second if it changes.

    Attributes:
        notes: Notes on the run, or on its last frame.
        latency: Sentences on the latency; empty if unknown.
        is_recording: Whether an animation is being recorded.
    """

    notes: list[str]
    latency: str
    is_recording: bool


class FrameFacts(Record, frozen=True, kw_only=True):
    """What is sent along with the arrays of a frame.

    Attributes:
        number: Number of the frame.
        time: Time of the sample on the board's clock, s.
        quality: How far the frame can be trusted; "starting" until the device's rest is known.
        quality_text: The same for users.
        marker_radius: Mean radius of the markers' 90 % intervals, mm; None if unknown.
        tracking_error: RMS distance of the markers from where cameras saw them, mm; None without.
        controls: Values of the controls by name, within 0..1 or -1..1.
        confidence: Confidence in each control by name, 0..1.
    """

    number: int
    time: float
    quality: Literal["trusted", "untrained", "fallback", "lost", "starting"]
    quality_text: str
    marker_radius: float | None
    tracking_error: float | None
    controls: dict[str, float]
    confidence: dict[str, float]


class WatchResult(Result, frozen=True, kw_only=True):
    """The newest frame's facts; None before the first frame."""

    facts: FrameFacts | None


class WatchLive(Request, frozen=True, kw_only=True):
    """Start or stop to send the frames of the live device to this browser."""

    result: ClassVar[type | None] = WatchResult
    lane: ClassVar[str] = "live"

    is_watching: bool


class TakeRest(Request, frozen=True, kw_only=True):
    """Take the present readings as those of the device at rest."""

    lane: ClassVar[str] = "live"


class UndoTakeRest(Request, frozen=True, kw_only=True):
    """Use the resistances at rest as they were before the last `TakeRest`."""

    lane: ClassVar[str] = "live"


class BendTwin(Request, frozen=True, kw_only=True):
    """Bend the simulated device that runs live.

    Attributes:
        levels: Level of each pose by its name, 0 to 1; None lets the device move automatically.
    """

    lane: ClassVar[str] = "live"

    levels: dict[str, float] | None


class AnimationResult(Result, frozen=True, kw_only=True):
    """What was started or written."""

    text: str


class RecordAnimation(Request, frozen=True, kw_only=True):
    """Start to record an animation, or stop and write it."""

    result: ClassVar[type | None] = AnimationResult
    lane: ClassVar[str] = "animation"

    is_on: bool


class GuidedKey(Record, frozen=True, kw_only=True):
    """A key of a guided run.

    Attributes:
        name: "enter", or a character in lower case.
        label: What it does; empty for a second name of another key.
        action: What it does.
        hint: When it is used; empty if the label says it.
    """

    name: str
    label: str
    action: Literal["start", "complete", "skip", "repeat", "back", "stop"]
    hint: str


class GuidedBars(Record, frozen=True, kw_only=True, tag_field="part", tag="bars"):
    """Rows of one or several bars each.

    Attributes:
        title: What is shown; empty for none.
        names: Names of the rows (r,); empty for none.
        texts: Texts after the rows (r,); empty for none.
        values: Filled share of each bar (r, c), 0 to 1.
        bands: Expected range of each row (r, 2); empty for none.
        states: State of each row (r,), "ok", "fault" or ""; empty for none.
        colors: Number of the color of each row (r,); empty for one color.
    """

    title: str
    names: list[str]
    texts: list[str]
    values: list[list[float]]
    bands: list[list[float]]
    states: list[str]
    colors: list[int]


class GuidedCurve(Record, frozen=True, kw_only=True):
    """Points or a line of a plot.

    Attributes:
        name: Name in the legend; empty for none.
        x: Coordinates (n,).
        y: Coordinates (n,).
        color: Number of the color; None for gray.
        is_line: Whether the points are connected.
    """

    name: str
    x: list[float]
    y: list[float]
    color: int | None
    is_line: bool


class GuidedPlot(Record, frozen=True, kw_only=True, tag_field="part", tag="plot"):
    """A plot of curves.

    Attributes:
        title: What is shown, with the limits of the axes; empty for none.
        curves: The curves, the last one on top.
        x: Limits of x, left and right.
        y: Limits of y, bottom and top.
        aspect: Height relative to the width.
        has_axes: Whether the lines x = 0 and y = 0 are drawn.
    """

    title: str
    curves: list[GuidedCurve]
    x: list[float]
    y: list[float]
    aspect: float
    has_axes: bool


class GuidedPicture(Record, frozen=True, kw_only=True, tag_field="part", tag="picture"):
    """The picture of a camera, which is sent as arrays under the name `array`.

    Attributes:
        name: Name of the camera.
        caption: What the camera sees.
        array: Name of the arrays with the picture as JPEG.
        has_image: Whether there is a recent picture.
    """

    name: str
    caption: str
    array: str
    has_image: bool


class GuidedState(Event, frozen=True, kw_only=True):
    """The state of a guided run.

    Attributes:
        run: Title of the run; empty if none runs.
        phase: Phase of the run.
        step: Number of the step, from 0.
        done: Numbers of the finished steps.
        title: Name of the step and its number.
        instruction: What the user has to do; the words between `**` are emphasized.
        status: Lines with what was received.
        progress: Share of the step or of the run that is over, 0 to 1; None for none.
        keys: Keys of the phase.
        parts: Pictures, bars and plots.
        notes: What the user should attend to.
        alerts: How often the user was alerted in this run.
    """

    run: str
    phase: Literal["ready", "active", "waiting", "done"] = "ready"
    step: int = 0
    done: list[int] = field(default_factory=list)
    title: str = ""
    instruction: str = ""
    status: list[str] = field(default_factory=list)
    progress: float | None = None
    keys: list[GuidedKey] = field(default_factory=list)
    parts: list[GuidedBars | GuidedPlot | GuidedPicture] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    alerts: int = 0


class PressKey(Request, frozen=True, kw_only=True):
    """Press a key of the guided run.

    Attributes:
        key: Name of the key.
        step: Number of the step that was shown: a key for another step is ignored.
        phase: Phase that was shown, as for the step.
    """

    lane: ClassVar[str] = "live"

    key: str
    step: int
    phase: Literal["ready", "active", "waiting", "done"]
