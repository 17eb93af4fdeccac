"""Preparation of a guided recording: its session, cameras and read-out board, real or simulated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...capture.cameras.image_sources import ImageSource, Webcam
from ...capture.clocks.led_schedule import LED_PERIOD_MS
from ...capture.readout.reader import ReadoutSettings
from ...capture.readout.source import Source
from ...capture.sessions import session as sessions
from ...capture.sessions.guided_recording import CaptureScreen, GuidedRecording, Hands
from ...capture.sessions.pose_coverage import PoseCoverage
from ...capture.sessions.session import CaptureSession
from ...capture.tags.tag_patterns import dictionary
from ...capture.videos.video_detection import compile_detector
from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import CaptureError, DefsenseError, DeviceError
from ...core.markers import Markers
from ...core.storage.session_manifest import manifest_path
from ...store.layout import LAYOUT, layout_hash, load_layout
from .live_twin import LiveTwin, load_pose_coverage, start_live_twin, write_true_cameras
from .sample_sources import open_source

NONE, TWIN = "none", "twin"
DEFAULT_REFERENCE_OHM = 2200.0  # of dividers whose reference is not known


@dataclass(frozen=True)
class CaptureOptions:
    """Options of a guided recording.

    Attributes:
        cameras: Addresses of the cameras in the order of the calibration, `("none",)`, or any one
            name for those of a twin.
        port: Port of the read-out board, `none` or `twin`.
        calibration: File of the cameras' calibration; None for `cameras.toml`, or for the true
            cameras of a twin.
        twin: Seed, number and kind of a twin's cameras; None for real ones.
        rounds: Number of rounds through the poses.
        seconds: Time for each pose, s.
        free: Time for free mixtures in each round, s.
        rest: Time at rest, s.
        rate: Sample rate of the board, Hz.
        references: Returns the reference resistances (c,) ohm of c dividers; None for defaults.
        unit: Name of the built device; None if it is not given.
        video: Whether videos are recorded.
    """

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
    """A guided recording that is ready to start.

    Attributes:
        session: The session.
        openers: Open the cameras.
        board: The read-out board; None without one.
        levels: Measures how far each pose was shown; None for a device that is not built.
        hands: Moves the twin of a device; None for real devices.
        is_resumed: Whether the session was started before.
        video: Whether videos are recorded.
    """

    session: CaptureSession
    openers: Sequence[Callable[[], ImageSource]]
    board: Source | None
    levels: PoseCoverage | None
    hands: Hands | None
    is_resumed: bool
    video: bool

    def record(self, screen: CaptureScreen, *, auto: bool = False) -> bool:
        """Record the session. A new session that cannot start leaves no files.

        Args:
            screen: Shows the recording.
            auto: Whether steps start automatically.

        Returns:
            Whether all steps were shown.

        Raises:
            CaptureError: A camera or the board fails.
            StorageError: Files cannot be written.
        """
        try:
            return GuidedRecording(
                self.session,
                self.openers,
                self.board,
                screen,
                self.levels,
                auto=auto,
                video=self.video,
                hands=self.hands,
            ).run()
        except DefsenseError:
            if not self.is_resumed:
                sessions.discard_empty(self.session)
            raise


def set_up_capture(
    device: Device,
    markers: Markers,
    folder: Path,
    options: CaptureOptions,
    stack: ExitStack,
    note: Callable[[str], None],
) -> CaptureSetup:
    """Prepare a guided recording.

    Args:
        device: The device.
        markers: The tags on it.
        folder: Folder of the session, which is resumed if it exists.
        options: Options of the recording.
        stack: Receives what must be closed after the recording.
        note: Called with what takes time.

    Raises:
        DeviceError: The options do not fit together (`nothing-to-record`, `twin-incomplete`).
        CaptureError: The session cannot be resumed, or a source cannot be opened.
        StorageError: Files cannot be written.
    """
    if options.cameras == (NONE,) and options.port == NONE:
        raise DeviceError(
            "there are neither cameras nor a read-out board, so that there is nothing to record",
            code="nothing-to-record",
            where="recording",
            action="Choose cameras, a port, or both",
        )
    twin = _start_twin(device, markers, options, stack)
    is_resumed = manifest_path(folder) is not None
    session = (
        _resume_session(device, markers, folder, options)
        if is_resumed
        else _create_session(device, markers, folder, options, twin)
    )
    try:
        openers = _camera_openers(options.cameras, session, twin)
        board = None
        if options.port != NONE:
            count = len(session.channels)
            settings = ReadoutSettings(channels=count, rate=options.rate, led=LED_PERIOD_MS)
            port = twin.port() if twin is not None else options.port
            board = open_source(port, settings).source
        if session.rig.cameras:  # compiled before the screen opens and the first frames come
            compile_detector(session.rig.cameras[0], dictionary(session.markers.dictionary), note)
        levels = load_pose_coverage(device, session.markers)
    except DefsenseError:
        if not is_resumed:
            sessions.discard_empty(session)
        raise
    hands = twin.perform if twin is not None else None
    return CaptureSetup(session, openers, board, levels, hands, is_resumed, options.video)


def _start_twin(
    device: Device, markers: Markers, options: CaptureOptions, stack: ExitStack
) -> LiveTwin | None:
    """Return the twin, if one is requested; reject a twin's cameras with a real board."""
    if options.twin is None and options.port != TWIN:
        return None
    if options.twin is None or len(options.cameras) > 1 or options.port not in (TWIN, NONE):
        raise DeviceError(
            "a twin has its own cameras and its own read-out board",
            code="twin-incomplete",
            where="recording",
            action="Choose the twin for both the cameras and the port",
        )
    seed, count, kind = options.twin
    twin = start_live_twin(device, markers, seed, count, kind=kind)
    stack.callback(twin.close)
    return twin


def _resume_session(
    device: Device, markers: Markers, folder: Path, options: CaptureOptions
) -> CaptureSession:
    session = sessions.load(folder)
    if session.device != device.name:
        raise CaptureError(
            f"is a session of {session.device}, not of {device.name}",
            code="session-of-another-device",
            where=folder,
            action="Choose another folder",
            device=session.device,
        )
    if options.unit is not None and options.unit != session.unit:
        raise CaptureError(
            f"is a session of the unit {session.unit!r}, not of {options.unit!r}",
            code="session-of-another-unit",
            where=folder,
            action="Choose another folder",
            unit=session.unit,
        )
    if not np.array_equal(session.markers.ids, markers.ids) or not np.allclose(
        session.markers.centers, markers.centers
    ):
        raise CaptureError(
            "was started with other tags than the device has now",
            code="session-tags-differ",
            where=folder,
            action="Start another session in another folder",
        )
    if len(sessions.finished_steps(session)) == len(session.steps):
        raise CaptureError(
            "this session is finished",
            code="session-finished",
            where=folder,
            action=f"Process it (defsense capture process {folder}), or choose another folder",
        )
    return session


def _create_session(
    device: Device, markers: Markers, folder: Path, options: CaptureOptions, twin: LiveTwin | None
) -> CaptureSession:
    build = build_folder(device)
    if (build / LAYOUT).exists():
        layout = load_layout(build, CaptureError)
        channels: Sequence[str] = [cord.name for cord in layout.by_channel()]
        layout_id = layout_hash(layout)
    else:
        channels, layout_id = [s.name for s in device.sensors], ""
    if options.port == NONE:
        channels = []
    count = max(len(channels), 1)
    if options.references is not None:
        references = list(options.references(count))
    else:
        references = [DEFAULT_REFERENCE_OHM if twin is None else twin.reference] * count
    calibration: Path | None = options.calibration or Path("cameras.toml")
    if options.cameras == (NONE,):
        calibration = None
    if twin is not None and options.calibration is None:
        calibration = device.source / "twin-cameras.toml"
        write_true_cameras(twin, calibration)
    poses = [p.name for p in device.poses]
    steps = sessions.plan_steps(poses, options.rounds, options.seconds, options.free, options.rest)
    return sessions.create(
        folder,
        device=device.name,
        steps=steps,
        channels=channels,
        reference=references[: len(channels)],
        calibration=calibration,
        markers=markers,
        unit=unit_name(options),
        layout=layout_id,
    )


def unit_name(options: CaptureOptions) -> str:
    """Return the name of the built device; the seed of a twin makes another one."""
    if options.unit is None and options.port == TWIN and options.twin is not None:
        return f"twin-{options.twin[0]}"
    return options.unit or ""


def _camera_openers(
    addresses: Sequence[str], session: CaptureSession, twin: LiveTwin | None
) -> list[Callable[[], ImageSource]]:
    cameras = session.rig.cameras
    if tuple(addresses) == (NONE,) and not cameras:
        return []
    if twin is not None:
        if len(twin.sources) != len(cameras):
            raise CaptureError(
                f"was started with {len(cameras)} cameras; the twin has {len(twin.sources)}",
                code="camera-count-differs",
                where=session.folder,
                action=f"Choose a twin with {len(cameras)} cameras",
                expected=len(cameras),
                given=len(twin.sources),
            )
        return [partial(_identity, s) for s in twin.sources]
    if len(addresses) != len(cameras):
        names = ", ".join(c.name for c in cameras)
        raise CaptureError(
            f"{len(addresses)} cameras are given; the calibration has {len(cameras)} ({names})",
            code="camera-count-differs",
            where="cameras",
            action="Give one camera for each, in this order",
            expected=len(cameras),
            given=len(addresses),
        )
    if not session.rig.placed:
        raise CaptureError(
            "the calibration does not contain the positions of the cameras",
            code="cameras-not-placed",
            where="cameras",
            action="Run 'defsense capture camera arrange'",
        )
    return [partial(Webcam, w, c.size) for w, c in zip(addresses, cameras, strict=True)]


def _identity(source: ImageSource) -> ImageSource:
    return source
