"""A guided recording put together: session, cameras, read-out board, or the twin of all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...capture.cameras.image_sources import Images, Webcam
from ...capture.clocks.led_schedule import LED_PERIOD_MS
from ...capture.readout.reader import ReadoutSettings
from ...capture.readout.source import Source
from ...capture.sessions import session as sessions
from ...capture.sessions.guided_recording import CaptureScreen, GuidedRecording, Hands
from ...capture.sessions.pose_coverage import PoseCoverage
from ...capture.sessions.session import CaptureSession
from ...capture.tags.tag_patterns import dictionary
from ...capture.videos.detector_compilation import compile_detector
from ...core.device.device import Device
from ...core.errors import CaptureError, DefsenseError, DeviceError
from ...core.markers import Markers
from ...core.device.build_folder import build_folder
from ...core.storage.session_manifest import manifest_path
from ...store.layout import LAYOUT, layout_hash, load_layout
from .live_twin import LiveTwin, write_true_cameras, load_pose_coverage, start_live_twin
from .sample_sources import open_source

NONE, TWIN = "none", "twin"
REFERENCE = 2200.0  # ohm, of dividers that nothing tells


@dataclass(frozen=True)
class CaptureOptions:
    """What a recording is asked for: `cameras` by the order of the `calibration`, ("none",), or
    those of a twin, whose seed, number and kind of cameras are then in `twin`; the `port` of the
    read-out board, "none" or "twin"; how the poses go round, s; `references` (c,) ohm of the
    dividers of c channels, None: as usual; of which `unit`, None where nobody said so."""

    cameras: tuple[str, ...]
    port: str
    calibration: Path | None = None
    twin: tuple[int, int, str] | None = None
    rounds: int = 2
    seconds: float = 8.0
    free: float = 15.0
    rest: float = 4.0
    rate: int = 50
    references: Callable[[int], Sequence[float]] | None = None
    unit: str | None = None
    video: bool = False


@dataclass(frozen=True)
class CaptureSetup:
    """What `GuidedRecording` takes; whether the session was `begun` before."""

    session: CaptureSession
    openers: Sequence[Callable[[], Images]]
    board: Source | None
    levels: PoseCoverage | None
    hands: Hands | None
    begun: bool
    video: bool

    def record(self, screen: CaptureScreen, *, auto: bool = False) -> bool:
        """Whether all steps were shown. A session that could not begin leaves nothing. Raises
        CaptureError and StorageError."""
        try:
            return GuidedRecording(
                self.session, self.openers, self.board, screen, self.levels, auto=auto,
                video=self.video, hands=self.hands,
            ).run()  # fmt: skip
        except DefsenseError:
            if not self.begun:
                sessions.discard_empty(self.session)
            raise


def set_up_capture(
    device: Device, markers: Markers, folder: Path, options: CaptureOptions, stack: ExitStack,
    note: Callable[[str], None],
) -> CaptureSetup:  # fmt: skip
    """Of the session in a `folder`, begun or to be begun; what is to be closed afterwards goes on
    the `stack`. Raises DeviceError for what does not go together, CaptureError, StorageError."""
    if options.cameras == (NONE,) and options.port == NONE:
        raise DeviceError("--cameras none --port none: there would be nothing to record")
    twin = _twin(device, markers, options, stack)
    begun = manifest_path(folder) is not None
    session = (
        _resumed(device, markers, folder, options)
        if begun
        else _begin(device, markers, folder, options, twin)
    )
    try:
        openers = _openers(options.cameras, session, twin)
        board = None
        if options.port != NONE:
            settings = ReadoutSettings(channels=len(session.channels), rate=options.rate, led=LED_PERIOD_MS)
            port = twin.port() if twin is not None else options.port
            board = open_source(port, settings).source
        if session.rig.cameras:  # before a screen is there, and the first pictures come
            compile_detector(session.rig.cameras[0], dictionary(session.markers.dictionary), note)
        levels = load_pose_coverage(device, session.markers)
    except DefsenseError:
        if not begun:
            sessions.discard_empty(session)
        raise
    hands = twin.perform if twin is not None else None
    return CaptureSetup(session, openers, board, levels, hands, begun, options.video)


def _twin(
    device: Device, markers: Markers, options: CaptureOptions, stack: ExitStack
) -> LiveTwin | None:
    """Raises DeviceError where only one of cameras and read-out board is a twin's."""
    if options.twin is None and options.port != TWIN:
        return None
    if options.twin is None or len(options.cameras) > 1 or options.port not in (TWIN, NONE):
        raise DeviceError(
            "a twin has its own cameras and read-out board: give --cameras twin --port twin"
        )
    seed, count, kind = options.twin
    twin = start_live_twin(device, markers, seed, count, kind=kind)
    stack.callback(twin.close)
    return twin


def _resumed(
    device: Device, markers: Markers, folder: Path, options: CaptureOptions
) -> CaptureSession:
    session = sessions.load(folder)
    if session.device != device.name:
        raise CaptureError(
            f"{folder}: is a session of {session.device}, not of {device.name}; choose another"
            " folder with --out"
        )
    if options.unit is not None and options.unit != session.unit:
        raise CaptureError(
            f"{folder}: is a session of the unit {session.unit!r}, not of {options.unit!r};"
            " choose another folder with --out"
        )
    if not np.array_equal(session.markers.ids, markers.ids) or not np.allclose(
        session.markers.centers, markers.centers
    ):
        raise CaptureError(
            f"{folder}: was begun with other tags than the device has now; begin another"
            " session with --out"
        )
    if len(sessions.finished(session)) == len(session.steps):
        raise CaptureError(
            f"{folder}: this session is finished; process it (defsense capture process"
            f" {folder}), or begin another with --out"
        )
    return session


def _begin(
    device: Device, markers: Markers, folder: Path, options: CaptureOptions, twin: LiveTwin | None
) -> CaptureSession:
    """A new session."""
    built = build_folder(device)
    if (built / LAYOUT).exists():
        layout = load_layout(built, CaptureError)
        channels: Sequence[str] = [cord.name for cord in layout.by_channel()]
        known_layout = layout_hash(layout)
    else:
        channels, known_layout = [s.name for s in device.sensors], ""
    if options.port == NONE:
        channels = []
    count = max(len(channels), 1)
    if options.references is not None:
        reference = list(options.references(count))
    else:
        usual = REFERENCE if twin is None else float(twin.extra["reference"])
        reference = [usual] * count
    calibration: Path | None = options.calibration or Path("cameras.toml")
    if options.cameras == (NONE,):
        calibration = None
    if twin is not None and options.calibration is None:
        calibration = device.source / "twin-cameras.toml"
        write_true_cameras(twin, calibration)
    return sessions.create(
        folder, device=device.name,
        steps=sessions.plan([p.name for p in device.poses], options.rounds, options.seconds,
                            options.free, options.rest),
        channels=channels, reference=reference[: len(channels)], calibration=calibration,
        markers=markers, unit=unit_name(options), layout=known_layout,
    )  # fmt: skip


def unit_name(options: CaptureOptions) -> str:
    """The name of the built device; a twin's seed makes another one."""
    if options.unit is None and options.port == TWIN and options.twin is not None:
        return f"twin-{options.twin[0]}"
    return options.unit or ""


def _openers(
    words: Sequence[str], session: CaptureSession, twin: LiveTwin | None
) -> list[Callable[[], Images]]:
    cameras = session.rig.cameras
    if tuple(words) == (NONE,) and not cameras:
        return []
    if twin is not None:
        if len(twin.sources) != len(cameras):
            raise CaptureError(
                f"{session.folder}: was begun with {len(cameras)} cameras; give --cameras"
                f" twin:cameras={len(cameras)}"
            )
        return [partial(_given, s) for s in twin.sources]
    if len(words) != len(cameras):
        names = ", ".join(c.name for c in cameras)
        raise CaptureError(
            f"the calibration has {len(cameras)} cameras ({names}), --cameras names {len(words)};"
            " give one for each, in this order"
        )
    if not session.rig.placed:
        raise CaptureError(
            "the calibration does not say where the cameras stand; run 'defsense capture camera"
            " arrange'"
        )
    return [partial(Webcam, w, c.size) for w, c in zip(words, cameras, strict=True)]


def _given(source: Images) -> Images:
    return source
