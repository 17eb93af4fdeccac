"""Set up a live run: source, decoder, controls, surface, view, outputs and recordings."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from ...capture.readout.ports import open_port
from ...capture.readout.reader import Reader, ReadoutSettings
from ...capture.readout.recording import Replay
from ...capture.readout.source import Source
from ...core.arrays import Float
from ...core.errors import ControlError, DefsenseError, LiveError
from ...core.progress import Progress, silent
from ...twin.recordings.walking_board import (
    WalkingBoard,
    parse_faults,
    simulate_walking_board,
)
from ..controls.control_bank import ControlBank
from ..controls.control_spec import ControlSpec
from ..controls.pose_amplitudes import RADIUS_90
from ..frames.live_decoder import LiveDecoder
from ..frames.live_frame import Note
from ..outputs.live_file import open_outputs
from ..outputs.output import LatestFrameSender
from ..outputs.settings import Settings as OutputSettings
from ..surface.live_surface import LiveSurface, Mode
from ..view.live_scene import ViewedDevice
from ..view.live_view import LiveView, PagePlace, PanelActions
from .live_device import LiveDevice, device_surface, typical_marker_sd
from .live_loop import SURFACE_BUDGET_S, FrameSink, LiveLoop
from .run_files import Animations, RawRecording, RunFolder, new_run_folder, since_last_run
from .session_play import SessionPlay, is_session

#: Resistors of dividers that are unknown, ohm.
REFERENCE = 2200.0
_TWIN, _REPLAY = "twin", "replay"
_ANIMATION_FILE = "animation.glb"
_MAX_VIEW_RATE_HZ = 60.0
_RECOVERY_S = 900.0  # since the last run; within it, cords that have set do not recover
_TWIN_DEFAULTS = {"unit": 1, "seed": 101, "minutes": 5}
_MAX_TWIN_MINUTES = 60


@dataclass(frozen=True)
class RunOptions:
    """Options of a run.

    Attributes:
        port: A serial port, socket://host:port, the .csv file of a recording, a processed session
            (replay:FOLDER), or the twin (twin, or twin:unit=1,seed=7,minutes=5,cut=left@20-30).
        rate: Samples per second, Hz.
        reference: Resistors of the dividers (c,), ohm, in the board's order, if known.
        rest: Resistances at rest (c,), ohm, in the board's order, if known.
        view: Port of a page, a place on an existing page, or None for no view.
        outputs: Settings of the outputs.
        controls: The controls; by default one for each pose.
        surface: How the surface is solved; None not to solve it.
        fallback: Whether to decode without a cord that fails.
        keep: Whether the raw readings are recorded.
        record: Folder of the recording; by default a new one in the device's folder.
        animation: File of an animation of the whole run, or None.
        live_file: File that `controls` were read from, for messages.
        views: Further receivers of frames with surfaces.
    """

    port: str
    rate: int = 100
    reference: Float | None = None
    rest: Float | None = None
    view: int | PagePlace | None = None
    outputs: tuple[OutputSettings, ...] = ()
    controls: tuple[ControlSpec, ...] = ()
    surface: Mode | None = "default"
    fallback: bool = True
    keep: bool = True
    record: Path | None = None
    animation: Path | None = None
    live_file: Path | None = None
    views: tuple[FrameSink, ...] = ()


@dataclass
class LiveRun:
    """A run that is ready for `loop.start()`.

    Attributes:
        device: Name of the device.
        port: The port it is read from.
        loop: The loop.
        outputs: The outputs.
        view: The view, or None.
        recording: Recording of the raw readings, or None.
        animations: The animations, or None without a surface.
        twin: The simulated device, or None.
        surface: Description of how the surface is solved; empty without one.
        notes: What the user should know before the start.
    """

    device: str
    port: str
    loop: LiveLoop
    outputs: Sequence[LatestFrameSender]
    view: LiveView | None
    recording: RawRecording | None
    animations: Animations | None = None
    twin: WalkingBoard | None = None
    surface: str = ""
    notes: list[Note] = field(default_factory=list)

    def end(self) -> None:
        """Close everything that is live: port, outputs, view and the recording of the readings.

        Animations, which are slow to write, are left to `close`.
        """
        self.loop.close()

    def close(self) -> None:
        """End the run, and write an animation that is being recorded.

        Raises:
            StorageError: The animation cannot be written.
            LiveError: It has no frames.
        """
        self.end()
        if self.animations is not None:
            try:
                self.animations.finish()
            finally:
                self.animations.discard()


def live_run(live: LiveDevice, options: RunOptions, progress: Progress = silent) -> LiveRun:
    """Set up a run.

    Args:
        live: The device.
        options: What to run.
        progress: Progress callback.

    Raises:
        LiveError: The options do not fit the device.
        CaptureError: The source cannot be read.
        OutputError: The view cannot be opened.
        StorageError: Nothing can be written to the folder of the run.
    """
    model, notes = live.model, list[Note]()
    twin = _open_twin(live, options.port, progress)
    reference = _choose_reference(live, options, twin, notes)
    source = _open_source(live, options, reference, twin)
    decoder = _make_decoder(live, options)
    controls = _make_controls(live, options)
    folder = new_run_folder(live.device.source if live.device else Path())
    if options.record is not None:
        folder = RunFolder(options.record)
    views, view, surface = list(options.views), None, None
    animations: Animations | None = None
    with contextlib.ExitStack() as undo:
        if options.surface and (options.view is not None or options.animation or views):
            surface, animations = _make_surface(live, options, folder, notes, progress)
        if animations is not None:
            undo.callback(animations.discard)
            views.append(animations)
        actions = panel_actions(decoder, animations, folder)
        if options.view is not None:
            view = LiveView(_viewed_device(live), actions, options.view)
            views.append(LatestFrameSender("view", partial(_identity, view), _MAX_VIEW_RATE_HZ))
            undo.callback(view.close)
        outputs = open_outputs(options.outputs)
        for output in outputs:
            undo.callback(output.close)
        recording = _make_recording(live, options, folder)
        undo.pop_all()
    loop = LiveLoop(
        source,
        decoder,
        live.board_channels,
        reference,
        controls=controls,
        surface=surface,
        outputs=outputs,
        views=views,
        recorder=recording,
        tracks=source.tracks if isinstance(source, SessionPlay) else None,
    )
    connect_panel(actions, loop)
    return LiveRun(
        device=model.device,
        port=options.port,
        loop=loop,
        outputs=outputs,
        view=view,
        recording=recording,
        animations=animations,
        twin=twin,
        surface=surface.description if surface is not None else "",
        notes=notes,
    )


def panel_actions(
    decoder: LiveDecoder, animations: Animations | None, folder: RunFolder
) -> PanelActions:
    """Return the actions of the view's panel.

    Args:
        decoder: Decoder of the run.
        animations: Its animations; None for no button to record.
        folder: Folder of the run, which animations go to.
    """
    if animations is None:
        return PanelActions(decoder.rest_now)
    return PanelActions(
        decoder.rest_now,
        record_action(animations, folder),
        lambda: animations.recording is not None,
    )


def record_action(animations: Animations, folder: RunFolder) -> Callable[[bool], str]:
    """Return a function that starts or stops an animation in the run's folder.

    It returns a message about the result.
    """

    def record(is_on: bool) -> str:
        try:
            if is_on:
                return f"recording into {animations.start(folder.make() / _ANIMATION_FILE)}"
            saved = animations.finish()
        except DefsenseError as error:
            again = "; press again to retry" if animations.recording and not is_on else ""
            return f"{error}{again}"
        return "no animation was being recorded" if saved is None else saved.summary

    return record


def connect_panel(actions: PanelActions, loop: LiveLoop) -> None:
    """Let the panel show the loop's notes and its latency."""
    actions.notes = lambda: loop.status.notes
    actions.latency = lambda: format_latency(loop.status.view_latency)


def format_latency(latency: tuple[float, float]) -> str:
    """Return a sentence on the median and 99th percentile of the latency, s; empty for NaN."""
    if not all(map(math.isfinite, latency)):
        return ""
    median, high = (1e3 * s for s in latency)
    return f"{median:.0f} ms from the sample to the view (99 %: {high:.0f} ms)"


def _make_decoder(live: LiveDevice, options: RunOptions) -> LiveDecoder:
    order = [live.board_channels.index(name) for name in live.model.channels]
    return LiveDecoder(
        live.model,
        None if options.rest is None else options.rest[order],
        live.trained_rest,
        first_rest_signals=_first_rest_signals(live, options.port),
        fallback=options.fallback,
    )


def _make_controls(live: LiveDevice, options: RunOptions) -> ControlBank | None:
    where = options.live_file if options.live_file is not None else ""
    if live.poses is None:
        if options.controls:
            raise LiveError(
                "controls need the poses of a built device",
                code="device-not-built",
                where=where,
                action="Give the folder of the built device",
            )
        return None
    model = live.model
    try:
        return ControlBank(
            live.poses, model.rest_points, options.controls, independent=len(model.channels)
        )
    except ControlError as error:
        located = ControlError(str(error), code=error.code, where=where)
        located.data = error.data
        raise located from None


def _make_surface(
    live: LiveDevice,
    options: RunOptions,
    folder: RunFolder,
    notes: list[Note],
    progress: Progress,
) -> tuple[LiveSurface | None, Animations | None]:
    """Prepare the surface, and solve it once to compile its functions."""
    if live.rest is None or live.states is None:
        if options.animation is not None:
            raise LiveError(
                "an animation needs a built device",
                code="device-not-built",
                where=options.animation,
                action="Give the folder of the built device",
            )
        text = "the device is not built: the view shows only markers; give its folder"
        notes.append(Note("device-not-built", text))
        return None, None
    progress("live", 0.5, "preparing the surface")
    surface = device_surface(live, options.surface or "default")
    surface(live.model.rest_points, None, SURFACE_BUDGET_S)
    surface.reset()
    device = live.device.source if live.device else Path()
    faces = np.asarray(live.rest.faces, np.int64)
    animations = Animations(live.rest.vertices, faces, (folder.make, lambda: device))
    if options.animation is not None:
        animations.start(options.animation)
    return surface, animations


def _identity(view: LiveView) -> LiveView:
    return view


def _open_source(
    live: LiveDevice, options: RunOptions, reference: Float, twin: WalkingBoard | None
) -> Source:
    """Return the source of a port; `reference` (c,) ohm is in the model's order."""
    kind, _, rest = options.port.partition(":")
    settings = ReadoutSettings(channels=len(live.model.channels), rate=options.rate)
    if twin is not None:
        return Reader(twin.open, options.port, settings, keep_items=False)
    if kind == _REPLAY or options.port.endswith(".csv"):
        path = Path(rest if kind == _REPLAY else options.port)
        if path.is_dir() and is_session(path):
            order = [live.model.channels.index(name) for name in live.board_channels]
            return SessionPlay(
                path, live.device, live.board_channels, live.model.ids, reference[order]
            )
        if not path.is_file():
            raise LiveError(
                "the recording does not exist",
                code="file-not-found",
                where=path,
                action="Give a board.csv, or the folder of a session",
            )
        return Replay(path)
    opener = partial(open_port, options.port)
    return Reader(opener, options.port, settings, keep_items=False)


def _open_twin(live: LiveDevice, port: str, progress: Progress) -> WalkingBoard | None:
    """Simulate the device of a twin's port; return None for other ports."""
    kind, _, words = port.partition(":")
    if kind != _TWIN:
        return None
    if live.device is None or live.states is None:
        raise LiveError(
            "a twin needs a built device",
            code="device-not-built",
            where=port,
            action="Give the folder of the built device",
        )
    values, faults = dict(_TWIN_DEFAULTS), []
    for word in filter(None, words.split(",")):
        name, equals, number = word.partition("=")
        if equals and name in values and number.isdecimal():
            values[name] = int(number)
        elif "@" in word:
            faults.append(word)
        else:
            raise LiveError(
                f"{word!r} is not an option of the twin",
                code="twin-option-unknown",
                where=port,
                action="Use any of twin:unit=1,seed=7,minutes=5,cut=NAME@20-30",
                option=word,
            )
    if not 1 <= values["minutes"] <= _MAX_TWIN_MINUTES:
        raise LiveError(
            f"minutes must be from 1 to {_MAX_TWIN_MINUTES}, not {values['minutes']}",
            code="out-of-range",
            where=port,
            field="minutes",
        )
    return simulate_walking_board(
        live.device,
        unit=values["unit"],
        seed=values["seed"],
        seconds=60.0 * values["minutes"],
        faults=parse_faults(live.board_channels, faults),
        progress=progress,
    )


def _first_rest_signals(live: LiveDevice, port: str) -> Float | None:
    """Return the signals in the first rest (c,), if the cords have not moved for long."""
    is_played = port.partition(":")[0] in (_TWIN, _REPLAY) or port.endswith(".csv")
    if not is_played and live.device and since_last_run(live.device.source) < _RECOVERY_S:
        return None
    return live.first_rest_signals


def _choose_reference(
    live: LiveDevice, options: RunOptions, twin: WalkingBoard | None, notes: list[Note]
) -> Float:
    """Return the dividers' resistors (c,), ohm, in the model's order.

    They are those of the options, else of the training, else of the twin, else the default.
    """
    order = [live.board_channels.index(name) for name in live.model.channels]
    if options.reference is not None:
        return options.reference[order]
    if live.reference is not None:
        return live.reference
    if twin is not None:
        return twin.runs.converter.reference[order]
    text = (
        f"the resistors of the dividers are unknown: {REFERENCE:g} ohm is assumed for each; give"
        " their values as reference"
    )
    notes.append(Note("reference-assumed", text, {"ohms": REFERENCE}))
    return np.full(len(order), REFERENCE)


def _viewed_device(live: LiveDevice) -> ViewedDevice:
    model, paths = live.model, {cord.name: cord.path for cord in live.cords}
    return ViewedDevice(
        name=model.device,
        vertices=None if live.rest is None else live.rest.vertices,
        faces=None if live.rest is None else live.rest.faces,
        channels=model.channels,
        cords=tuple(paths[name] for name in model.channels if name in paths),
        cord_radius=live.device.cord.diameter / 2 if live.device else 1.0,
        low=model.main.range.low,
        high=model.main.range.high,
        radius=float(RADIUS_90 * np.median(typical_marker_sd(model))),
    )


def _make_recording(
    live: LiveDevice, options: RunOptions, folder: RunFolder
) -> RawRecording | None:
    if not options.keep or options.port.endswith(".csv") or options.port.startswith(_REPLAY):
        return None
    return RawRecording(folder, len(live.board_channels))
