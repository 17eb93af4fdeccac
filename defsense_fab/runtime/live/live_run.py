"""A live run put together: device, port, loop, controls, surface, view, outputs, recording."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from ...capture.readout.ports import open_port
from ...capture.readout.reader import Reader, ReadoutSettings
from ...capture.readout.recording import Replay
from ...capture.readout.source import Source
from ...core.arrays import Float
from ...core.errors import ControlError, LiveError
from ...core.progress import Progress, silent
from ...twin.recordings.walking_board import WalkingBoard, parse_faults, simulate_walking_board
from ..controls.control_bank import ControlBank
from ..controls.control_spec import ControlSpec
from ..controls.pose_amplitudes import RADIUS_90
from ..frames.live_decoder import LiveDecoder
from ..outputs.live_file import open_outputs
from ..outputs.output import LatestFrameSender
from ..outputs.settings import Settings as OutputSettings
from ..surface.live_surface import LiveSurface, Mode
from ..view.live_scene import ViewedDevice
from ..view.live_view import LiveView, PagePlace
from .animations import Animations
from .device_surface import device_surface, typical_deviation
from .live_device import LiveDevice
from .live_loop import BUDGET, LiveLoop, Sending
from .panel_links import follow, panel_actions
from .raw_recording import RawRecording, since_last_run
from .run_folder import RunFolder, new_run_folder
from .session_play import SessionPlay, is_session

REFERENCE = 2200.0  # ohm, of dividers that nothing tells
_TWIN, _REPLAY = "twin", "replay"
_VIEW_RATE = 60.0  # Hz, at most
_RECENT = 900.0  # s, in which cords that have set do not recover


@dataclass(frozen=True)
class RunOptions:
    """What a run is asked for. `port`: a serial port, socket://host:port, a recording's .csv or a
    processed session (replay:FILE), or twin (twin:unit=1,seed=7,minutes=5,cut=left@20-30).
    `reference` and `rest` (c,) ohm in the order of the wires, where they are known; `view` is the
    port of a page of its own, or a place of one that is there, None without one;
    whether the readings are kept (`keep`), in the folder `record` or in a new one of the device's;
    the file of an `animation`, None: none. `live_file` is where `controls` were read from, if from
    a file. `surface` is how it is solved, None: not at all; `views` get frames with it, besides.
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
    views: tuple[Sending, ...] = ()


@dataclass
class LiveRun:
    """A run of the `device` of that name, read from `port`, ready to `loop.start()`; `notes` are
    what a user should know before."""

    device: str
    port: str
    loop: LiveLoop
    outputs: Sequence[LatestFrameSender]
    view: LiveView | None
    recording: RawRecording | None
    animations: Animations | None = None
    twin: WalkingBoard | None = None
    surface: str = ""
    notes: list[str] = field(default_factory=list)

    def end(self) -> None:
        """Close all that is live: port, outputs, view, and the readings' file. What is slow is left
        to `close`."""
        self.loop.close()

    def close(self) -> None:
        """End it, and write an animation that is being recorded. Raises StorageError and LiveError
        where none can be written."""
        self.end()
        if self.animations is not None:
            try:
                self.animations.finish()
            finally:
                self.animations.discard()


def live_run(live: LiveDevice, options: RunOptions, progress: Progress = silent) -> LiveRun:
    """Raises LiveError, CaptureError, OutputError and StorageError for what cannot be opened."""
    model, notes = live.model, list[str]()
    twin = _twin(live, options.port, progress)
    reference = _reference(live, options, twin, notes)
    source = _source(live, options, reference, twin)
    order = [live.wired.index(name) for name in model.channels]
    rest = None if options.rest is None else options.rest[order]
    decoder = LiveDecoder(
        model, rest, live.trained_rest, first_rest_signals=_lying(live, options.port), fallback=options.fallback
    )
    controls = _controls(live, options)
    folder = new_run_folder(live.device.source if live.device else Path())
    if options.record is not None:
        folder = RunFolder(options.record)
    views, view, surface, told = list(options.views), None, None, ""
    animations: Animations | None = None
    with contextlib.ExitStack() as undo:
        if options.surface and (options.view is not None or options.animation or views):
            surface, animations = _surface(live, options, folder, notes, progress)
            told = surface.choice if surface is not None else ""
        if animations is not None:
            undo.callback(animations.discard)
            views.append(animations)
        actions = panel_actions(decoder, animations, folder)
        if options.view is not None:
            view = LiveView(_viewed(live), actions, options.view)
            views.append(LatestFrameSender("view", partial(_same, view), _VIEW_RATE))
            undo.callback(view.close)
        outputs = open_outputs(options.outputs)
        for each in outputs:
            undo.callback(each.close)
        recording = _recording(live, options, folder)
        undo.pop_all()
    loop = LiveLoop(
        source, decoder, live.wired, reference, controls=controls, surface=surface,
        outputs=outputs, views=views, recorder=recording,
        tracks=source.tracks if isinstance(source, SessionPlay) else None,
    )  # fmt: skip
    follow(actions, loop)
    return LiveRun(
        model.device, options.port, loop, outputs, view, recording, animations, twin, told, notes
    )


def _controls(live: LiveDevice, options: RunOptions) -> ControlBank | None:
    where = f"{options.live_file}: " if options.live_file is not None else ""
    if live.poses is None:
        if options.controls:
            raise LiveError(
                f"{where}[controls] need the poses of a built device: give its folder (--device)"
            )
        return None
    model = live.model
    try:
        return ControlBank(
            live.poses, model.rest_points, options.controls, independent=len(model.channels)
        )
    except ControlError as error:
        raise ControlError(f"{where}{error}") from None


def _surface(
    live: LiveDevice, options: RunOptions, folder: RunFolder, notes: list[str], progress: Progress
) -> tuple[LiveSurface | None, Animations | None]:
    """Solved once, which compiles what it needs."""
    if live.rest is None or live.states is None:
        if options.animation is not None:
            raise LiveError(
                f"{options.animation}: an animation needs a built device; give its folder"
                " (--device)"
            )
        notes.append(
            "no built device is known, so that the view shows markers alone; give its folder"
            " (--device)"
        )
        return None, None
    progress("live", 0.5, "preparing the surface")
    surface = device_surface(live, options.surface or "default")
    surface(live.model.rest_points, None, BUDGET)
    surface.reset()
    device = live.device.source if live.device else Path()
    animations = Animations(
        live.rest.vertices, np.asarray(live.rest.faces, np.int64), (folder.make, lambda: device)
    )
    if options.animation is not None:
        animations.start(options.animation)
    return surface, animations


def _same(view: LiveView) -> LiveView:
    return view


def _source(
    live: LiveDevice, options: RunOptions, reference: Float, twin: WalkingBoard | None
) -> Source:
    """With the dividers' `reference` (c,) ohm in the model's order."""
    word, _, rest = options.port.partition(":")
    settings = ReadoutSettings(channels=len(live.model.channels), rate=options.rate)
    if twin is not None:
        return Reader(twin.open, options.port, settings)
    if word == _REPLAY or options.port.endswith(".csv"):
        path = Path(rest if word == _REPLAY else options.port)
        if path.is_dir() and is_session(path):
            order = [live.model.channels.index(name) for name in live.wired]
            return SessionPlay(path, live.device, live.wired, live.model.ids, reference[order])
        if not path.is_file():
            raise LiveError(f"{path}: no such recording; give a board.csv, or a session's folder")
        return Replay(path)
    return Reader(partial(open_port, options.port), options.port, settings)


def _twin(live: LiveDevice, port: str, progress: Progress) -> WalkingBoard | None:
    """None for other ports."""
    kind, _, words = port.partition(":")
    if kind != _TWIN:
        return None
    if live.device is None or live.states is None:
        raise LiveError(f"{port}: a twin needs a built device; give its folder (--device)")
    values, faults = {"unit": 1, "seed": 101, "minutes": 5}, []
    for word in filter(None, words.split(",")):
        name, equals, number = word.partition("=")
        if equals and name in values and number.isdecimal():
            values[name] = int(number)
        elif "@" in word:
            faults.append(word)
        else:
            raise LiveError(f"{port}: write twin:unit=1,seed=7,minutes=5,cut=NAME@20-30, each or"
                            " none")  # fmt: skip
    if not 1 <= values["minutes"] <= 60:
        raise LiveError(f"{port}: minutes are from 1 to 60")
    return simulate_walking_board(
        live.device, unit=values["unit"], seed=values["seed"], seconds=60.0 * values["minutes"],
        faults=parse_faults(live.wired, faults), progress=progress,
    )  # fmt: skip


def _lying(live: LiveDevice, port: str) -> Float | None:
    """What signals are in the first rest (c,), of cords that have not moved for long; None where
    they have, or where that is not known."""
    played = port.partition(":")[0] in (_TWIN, _REPLAY) or port.endswith(".csv")
    if not played and live.device and since_last_run(live.device.source) < _RECENT:
        return None
    return live.lying


def _reference(
    live: LiveDevice, options: RunOptions, twin: WalkingBoard | None, notes: list[str]
) -> Float:
    """(c,) ohm in the model's order: as given, as the training tells, or as a twin has them."""
    order = [live.wired.index(name) for name in live.model.channels]
    if options.reference is not None:
        return options.reference[order]
    if live.reference is not None:
        return live.reference
    if twin is not None:
        return twin.runs.converter.reference[order]
    notes.append(
        f"the training does not tell the dividers' resistors: {REFERENCE:g} ohm are taken for"
        " each; give --reference"
    )
    return np.full(len(order), REFERENCE)


def _viewed(live: LiveDevice) -> ViewedDevice:
    model, by = live.model, {cord.name: cord.path for cord in live.cords}
    low, high = model.main.range.low, model.main.range.high
    return ViewedDevice(
        model.device, None if live.rest is None else live.rest.vertices,
        None if live.rest is None else live.rest.faces, model.channels,
        tuple(by[name] for name in model.channels if name in by),
        live.device.cord.diameter / 2 if live.device else 1.0, low, high,
        float(RADIUS_90 * np.median(typical_deviation(model))),
    )  # fmt: skip


def _recording(live: LiveDevice, options: RunOptions, folder: RunFolder) -> RawRecording | None:
    if not options.keep or options.port.endswith(".csv") or options.port.startswith(_REPLAY):
        return None
    return RawRecording(folder, len(live.wired))
