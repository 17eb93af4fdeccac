"""Prepare a live run: its source, decoder, controls, surface, view, outputs and recordings."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...capture.readout.network_url import FORGERY_WARNING, is_forgeable
from ...capture.readout.source import RecordingEnd as RecordingEnd
from ...capture.readout.source import Source
from ...core.arrays import Float
from ...core.device.build_folder import build_folder
from ...core.errors import ControlError, DefsenseError, LiveError
from ...core.progress import Progress, silent
from ...runtime.controls.control_bank import ControlBank
from ...runtime.controls.pose_amplitudes import RADIUS_90
from ...runtime.frames.fixed_decoder import FixedDecoder
from ...runtime.frames.live_decoder import LiveDecoder
from ...runtime.frames.live_frame import Note
from ...runtime.frames.live_frame import Quality as Quality
from ...runtime.live.live_loop import SURFACE_BUDGET_S, FrameSink, LiveLoop, Receivers
from ...runtime.live.loop_status import LiveStatus as LiveStatus
from ...runtime.live.run_files import (
    Animations,
    RawRecording,
    RunFolder,
    new_run_folder,
    since_last_run,
)
from ...runtime.outputs.live_file import LiveSettings as LiveSettings
from ...runtime.outputs.live_file import open_outputs
from ...runtime.outputs.output import LatestFrameSender
from ...runtime.recording.target_file import TARGETS, TargetFile
from ...runtime.surface.live_surface import LiveSurface
from ...runtime.view.live_page import LiveView
from ...runtime.view.live_place import LivePlace
from ...runtime.view.panel_actions import PanelActions
from ...runtime.view.viewed_device import ViewedDevice
from ...sensing.voltage_divider import REFERENCE_OHM, reference_resistors
from ...store.build import Build
from ...twin.recordings.walking_board import WalkingBoard
from .live_device import LiveDevice, device_surface, typical_marker_sd
from .options import RunOptions
from .sources import Port, SessionPlay, open_source, open_twin
from .target_sources import TextLines, open_target_source, refuse_surface

_ANIMATION_FILE = "animation.glb"
_MAX_VIEW_RATE_HZ = 60.0
_RECOVERY_S = 900.0  # since the last run; within it, cords that have set do not recover
_NO_OPTIONS, _NO_SETTINGS = RunOptions(), LiveSettings()


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
        surface: Description of how the surface is solved; empty without one.
        notes: What the user should know before the start.
        targets: File of the decoded targets of a sensor that is no device, or None.
    """

    device: str
    port: str
    loop: LiveLoop
    outputs: Sequence[LatestFrameSender]
    view: LiveView | None
    recording: RawRecording | None
    animations: Animations | None = None
    surface: str = ""
    notes: list[Note] = field(default_factory=list)
    targets: Path | None = None

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


def prepare_run(
    live: LiveDevice,
    port: str,
    options: RunOptions = _NO_OPTIONS,
    *,
    settings: LiveSettings = _NO_SETTINGS,
    view: int | LivePlace | None = None,
    receivers: Sequence[FrameSink] = (),
    keeps_readings: bool = True,
    progress: Progress = silent,
) -> LiveRun:
    """Prepare a live run of a device; call `loop.start()` on the result to start it.

    Args:
        live: The device.
        port: A serial port, socket://host:port, udp://HOST or tcp://HOST, the .csv file of a
            recording, a recording or a session (replay:PATH), or the twin
            (twin:unit=1,seed=7,minutes=5,cut=A@20-30).
        options: Options of the run.
        settings: The outputs, and the controls; by default one control for each pose.
        view: Port of a page, a place on an existing page, or None for no view.
        receivers: Further receivers of frames with surfaces.
        keeps_readings: Whether the raw readings are recorded; recordings that are played are not
            recorded again.
        progress: Progress callback.

    Raises:
        LiveError: The options do not fit the device.
        CaptureError: The source cannot be read.
        OutputError: The view cannot be opened.
        StorageError: Nothing can be written to the folder of the run.
    """
    if live.model.readings is not None:
        folder = RunFolder(options.record) if options.record else _new_folder(live)
        return _prepare_target_run(
            live, port, options, settings, view, receivers, folder if keeps_readings else None
        )
    notes, place = _first_notes(live, port), Port(port)
    twin = open_twin(live, place, progress)
    reference = _choose_reference(live, options, twin, notes)
    source = open_source(live, place, options.rate, reference, twin)
    decoder = _make_decoder(live, options, place)
    controls = _make_controls(live, settings)
    folder = RunFolder(options.record) if options.record else _new_folder(live)
    views = list(receivers)
    with contextlib.ExitStack() as undo:
        solver, animations, page, recording = None, None, None, None
        if options.surface and (view is not None or options.animation or views):
            solver, animations = _make_surface(live, options, folder, notes, progress)
        if animations is not None:
            undo.callback(animations.discard)
            views.append(animations)
        actions = panel_actions(decoder, animations, folder)
        if twin is not None:
            actions.bend, actions.poses = twin.cords.bend, twin.cords.poses
            if solver is not None and live.rest is not None:
                actions.shape = twin.shape_of(live.rest.vertices)
        if view is not None:
            page = LiveView(_viewed_device(live), actions, view)
            undo.callback(page.close)
            views.append(LatestFrameSender("view", lambda: page, _MAX_VIEW_RATE_HZ))
        outputs = open_outputs(settings.outputs)
        for output in outputs:
            undo.callback(output.close)
        if keeps_readings and not place.is_replay:
            recording = RawRecording(folder, len(live.board_channels))
        undo.pop_all()
    loop = LiveLoop(
        source,
        decoder,
        live.board_channels,
        reference,
        controls=controls,
        surface=solver,
        receivers=Receivers(outputs, views, recording),
        tracks=source.tracks if isinstance(source, SessionPlay) else None,
    )
    connect_panel(actions, loop)
    about = "" if solver is None else solver.description
    name = live.model.device
    return LiveRun(name, port, loop, outputs, page, recording, animations, about, notes)


def _prepare_target_run(
    live: LiveDevice,
    port: str,
    options: RunOptions,
    settings: LiveSettings,
    view: int | LivePlace | None,
    receivers: Sequence[FrameSink],
    folder: RunFolder | None,
) -> LiveRun:
    """Prepare a run of a sensor that is no device.

    The decoded targets are written to `folder`, and so are the readings of a board; None for none.
    A recording that is played is written only to a folder that the user gives.
    """
    model, place = live.model, Port(port)
    assert model.readings is not None
    refuse_surface(live.model, options, settings, has_view=view is not None)
    path = place.path if place.is_replay else None
    source: Source | None = open_target_source(port, path, model.channels, model.readings)
    notes, reference = _first_notes(live, port), None
    if source is None:
        reference = _choose_reference(live, options, None, notes)
        source = open_source(live, place, options.rate, reference, None)
    decoder = FixedDecoder(model, model.readings, fallback=options.fallback)
    outputs = open_outputs(settings.outputs)
    recording, files = None, list[TargetFile]()
    if folder is not None and (options.record or not place.is_replay):
        files.append(TargetFile(folder.make))
        if reference is not None:
            recording = RawRecording(folder, len(live.board_channels))
    loop = LiveLoop(
        source,
        decoder,
        live.board_channels,
        reference,
        receivers=Receivers(outputs, receivers, recording, files),
        decodes_all=isinstance(source, TextLines),
    )
    file = folder.path / TARGETS if folder is not None and files else None
    return LiveRun(model.device, port, loop, outputs, None, recording, notes=notes, targets=file)


def _new_folder(live: LiveDevice) -> RunFolder:
    return new_run_folder(live.device.source if live.device else Path())


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
        return PanelActions(decoder.rest_now, undo_rest=decoder.undo_rest_now)
    return PanelActions(
        decoder.rest_now,
        record_action(animations, folder),
        lambda: animations.recording is not None,
        undo_rest=decoder.undo_rest_now,
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
    """Let the panel show the loop's notes, its latency, and that of the board's network."""

    def describe_latency() -> str:
        status = loop.status
        network = "" if status.network is None else status.network.summary
        return "\n\n".join(filter(None, (format_latency(status.view_latency), network)))

    actions.notes = lambda: loop.status.notes
    actions.latency = describe_latency


def format_latency(latency: tuple[float, float]) -> str:
    """Return a sentence on the median and 99th percentile of the latency, s; empty for NaN."""
    if not all(map(math.isfinite, latency)):
        return ""
    median, high = (1e3 * s for s in latency)
    return f"{median:.0f} ms from the sample to the view (99 %: {high:.0f} ms)"


def _make_decoder(live: LiveDevice, options: RunOptions, port: Port) -> LiveDecoder:
    return LiveDecoder(
        live.model,
        None if options.rest is None else _in_model_order(live, "rest", options.rest),
        live.trained_rest,
        first_rest_signals=_first_rest_signals(live, port),
        fallback=options.fallback,
        is_handled=not port.is_twin,
    )


def _in_model_order(live: LiveDevice, name: str, resistances: Sequence[float]) -> Float:
    """Return the resistances (c,), ohm, of an option in the model's order of channels."""
    channels = live.board_channels
    values = dict(zip(channels, reference_resistors(resistances, len(channels), name), strict=True))
    return np.array([values[channel] for channel in live.model.channels])


def _make_controls(live: LiveDevice, settings: LiveSettings) -> ControlBank | None:
    where = "" if settings.path is None else settings.path
    if live.poses is None:
        if settings.controls:
            raise LiveError(
                "controls need the poses of a built device",
                code="not-built",
                where=where,
                action="Give the folder of the built device",
            )
        return None
    model = live.model
    try:
        return ControlBank(
            live.poses, model.rest_points, settings.controls, independent=len(model.channels)
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
                code="not-built",
                where=options.animation,
                action="Give the folder of the built device",
            )
        text = "the device is not built: the view shows only markers; give its folder"
        notes.append(Note("not-built", text))
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


def _first_rest_signals(live: LiveDevice, port: Port) -> Float | None:
    """Return the signals in the first rest (c,), if the cords have not moved for long."""
    is_played = port.is_twin or port.is_replay
    if not is_played and live.device and since_last_run(live.device.source) < _RECOVERY_S:
        return None
    return live.first_rest_signals


def _first_notes(live: LiveDevice, port: str) -> list[Note]:
    """Return a note on a model that its test found useless, and one on a port without a key."""
    notes, judgment = [], live.model.metadata.get("usefulness") or {}
    if judgment.get("code") is not None:
        notes.append(Note(judgment["code"], str(judgment["message"]), judgment))
    if is_forgeable(port):
        notes.append(Note("packets-forgeable", f"{port}: {FORGERY_WARNING}"))
    return notes


def _choose_reference(
    live: LiveDevice, options: RunOptions, twin: WalkingBoard | None, notes: list[Note]
) -> Float:
    """Return the dividers' resistors (c,), ohm, in the model's order.

    They are those of the options, else of the training, else of the twin, else of the assembly
    guide, else the default.
    """
    if options.reference is not None:
        return _in_model_order(live, "reference", options.reference)
    if live.reference is not None:
        return live.reference
    order = [live.board_channels.index(name) for name in live.model.channels]
    if twin is not None:
        return twin.runs.converter.reference[order]
    build = None if live.device is None else Build(build_folder(live.device))
    if build is not None and build.has_parts:
        resistors = np.array(build.reference_resistors)
        facts = {"ohms": resistors.tolist()}
        notes.append(Note("reference-of-the-guide", build.describe_resistors(), facts))
        return resistors[order]
    text = (
        f"the resistors of the dividers are unknown: {REFERENCE_OHM:g} ohm is assumed for each;"
        " give their values as reference"
    )
    notes.append(Note("reference-assumed", text, {"ohms": REFERENCE_OHM}))
    return np.full(len(order), REFERENCE_OHM)


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
