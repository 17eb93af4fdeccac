"""Record a device step by step, with cameras and a read-out board, real or simulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.cameras.image_sources import ImageSource, Webcam
from ...capture.clocks.led_schedule import LED_PERIOD_MS
from ...capture.readout.reader import ReadoutSettings
from ...capture.readout.source import Source
from ...capture.sessions import session as sessions
from ...capture.sessions.guided_recording import GuidedRecording
from ...capture.sessions.session import CaptureSession as CaptureSession
from ...capture.tags.tag_patterns import dictionary
from ...capture.videos.video_detection import compile_detector
from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import CaptureError, DefsenseError, DeviceError
from ...core.guided_run import Screen
from ...core.markers import Markers, read_markers
from ...core.storage.session_manifest import manifest_path
from ...sensing.voltage_divider import REFERENCE_OHM, reference_resistors
from ...store.build import Build
from ...store.layout import LAYOUT, layout_hash, load_layout
from ...twin.live.live_twin import (
    LiveTwin,
    load_pose_coverage,
    start_live_twin,
    write_true_cameras,
)
from ...twin.live.sample_sources import open_source
from ...twin.options import TWIN as TWIN
from ...twin.options import TwinCameras
from ...twin.options import is_twin as is_twin
from ..cameras.options import CALIBRATION_FILE
from ..tags.options import MARKERS_FOLDER
from .options import RecordOptions

#: Address of cameras, or of a read-out board, that are not used.
NONE = "none"
SESSION_FOLDER = "session"
TWIN_CALIBRATION_FILE = "twin-cameras.toml"
DEFAULT_OPTIONS = RecordOptions()

#: Opens the screen of a session that is ready to be recorded.
OpenScreen = Callable[[CaptureSession], AbstractContextManager[Screen]]


@dataclass(frozen=True)
class RecordedSession:
    """A session after one of its runs.

    Attributes:
        session: The session.
        is_complete: Whether all steps were recorded.
    """

    session: CaptureSession
    is_complete: bool

    @property
    def finished_steps(self) -> int:
        """Number of recorded steps."""
        return len(sessions.finished_steps(self.session))

    @property
    def last_run(self) -> Path:
        """Folder of the run."""
        return self.session.runs[-1]

    @property
    def ending(self) -> str:
        """Why the run ended."""
        return sessions.run_ending(self.last_run)

    @property
    def summary(self) -> Mapping[str, Any]:
        """Plain values for programs."""
        return sessions.session_summary(self.session)


def record_session(
    device: Device,
    cameras: Sequence[str],
    port: str,
    options: RecordOptions = DEFAULT_OPTIONS,
    *,
    open_screen: OpenScreen,
    auto: bool = False,
    note: Callable[[str], None] = lambda _: None,
) -> RecordedSession:
    """Record a session, or resume it. A new session that cannot start leaves no files.

    Args:
        device: The device.
        cameras: Addresses of the cameras in the order of the calibration; `("none",)`; or one
            address of simulated cameras, such as `twin:webcam,seed=1,cameras=2`.
        port: Port of the read-out board, `none` or `twin`.
        options: Options of the recording.
        open_screen: Opens the screen that shows the recording and reads keys.
        auto: Whether steps start automatically.
        note: Called with a text on a step of the preparation that takes time, or on an
            assumption.

    Raises:
        DeviceError: The sources do not fit together (`nothing-to-record`, `twin-incomplete`).
        CaptureError: The session cannot be resumed, or a camera or the board fails.
        StorageError: Files cannot be written.
    """
    if tuple(cameras) == (NONE,) and port == NONE:
        raise DeviceError(
            "there are neither cameras nor a read-out board, so that there is nothing to record",
            code="nothing-to-record",
            where="recording",
            action="Choose cameras, a port, or both",
        )
    markers = read_markers(options.markers or device.source / MARKERS_FOLDER)
    folder = options.out or device.source / SESSION_FOLDER
    with ExitStack() as stack:
        twin = _start_twin(device, markers, cameras, port)
        if twin is not None:
            stack.callback(twin.close)
        is_resumed = manifest_path(folder) is not None
        session = (
            _resume_session(device, markers, folder, options)
            if is_resumed
            else _create_session(device, markers, folder, (cameras, port), options, twin, note)
        )
        try:
            openers = _camera_openers(cameras, session, twin)
            board = _open_board(port, session, options, twin)
            if session.rig.cameras:  # compiled before the screen opens and the first frames come
                tags = dictionary(session.markers.dictionary)
                compile_detector(session.rig.cameras[0], tags, note)
            coverage = load_pose_coverage(device, session.markers)
            with open_screen(session) as screen:
                recording = GuidedRecording(
                    session,
                    openers,
                    board,
                    screen,
                    coverage,
                    auto=auto,
                    video=options.video,
                    hands=None if twin is None else twin.perform,
                )
                is_complete = recording.run()
        except DefsenseError:
            if not is_resumed:
                sessions.discard_empty(session)
            raise
    return RecordedSession(session, is_complete)


def _start_twin(
    device: Device, markers: Markers, cameras: Sequence[str], port: str
) -> LiveTwin | None:
    """Return the twin, if one is requested; reject a twin's cameras with a real board."""
    has_twin_cameras = is_twin(cameras[0])
    if not has_twin_cameras and port != TWIN:
        return None
    if not has_twin_cameras or len(cameras) > 1 or port not in (TWIN, NONE):
        raise DeviceError(
            "a twin has its own cameras and its own read-out board",
            code="twin-incomplete",
            where="recording",
            action="Choose the twin for both the cameras and the port",
        )
    return start_live_twin(device, markers, TwinCameras.parse(cameras[0]))


def _resume_session(
    device: Device, markers: Markers, folder: Path, options: RecordOptions
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
    device: Device,
    markers: Markers,
    folder: Path,
    sources: tuple[Sequence[str], str],
    options: RecordOptions,
    twin: LiveTwin | None,
    note: Callable[[str], None],
) -> CaptureSession:
    """Create the session that is recorded with cameras and a port, the `sources`."""
    cameras, port = sources
    build = Build(build_folder(device))
    if (build.folder / LAYOUT).exists():
        layout = load_layout(build.folder, CaptureError)
        channels: Sequence[str] = [cord.name for cord in layout.by_channel()]
        layout_id = layout_hash(layout)
    else:
        channels, layout_id = [s.name for s in device.sensors], ""
    if port == NONE:
        channels = []
    references = options.reference
    if references is None:
        references = (REFERENCE_OHM if twin is None else twin.reference,)
        if twin is None and channels and build.has_parts:
            references = build.reference_resistors
            note(build.describe_resistors())
    poses = [p.name for p in device.poses]
    return sessions.create(
        folder,
        device=device.name,
        steps=sessions.plan_steps(
            poses, options.rounds, options.seconds, options.free, options.rest
        ),
        channels=channels,
        reference=reference_resistors(references, max(len(channels), 1))[: len(channels)],
        calibration=_calibration_file(device, cameras, options, twin),
        markers=markers,
        unit=unit_name(options.unit, cameras, port),
        layout=layout_id,
    )


def _calibration_file(
    device: Device, cameras: Sequence[str], options: RecordOptions, twin: LiveTwin | None
) -> Path | None:
    """Return the calibration of the cameras, if there are any; write that of a twin."""
    if tuple(cameras) == (NONE,):
        return None
    if twin is not None and options.calibration is None:
        path = device.source / TWIN_CALIBRATION_FILE
        write_true_cameras(twin, path)
        return path
    return options.calibration or CALIBRATION_FILE


def unit_name(unit: str | None, cameras: Sequence[str], port: str) -> str:
    """Return the name of the built device; by default a twin's seed names its unit."""
    if unit is None and port == TWIN:
        return f"twin-{TwinCameras.parse(cameras[0]).seed}"
    return unit or ""


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
    return [partial(Webcam, a, c.size) for a, c in zip(addresses, cameras, strict=True)]


def _identity(source: ImageSource) -> ImageSource:
    return source


def _open_board(
    port: str, session: CaptureSession, options: RecordOptions, twin: LiveTwin | None
) -> Source | None:
    if port == NONE:
        return None
    settings = ReadoutSettings(channels=len(session.channels), rate=options.rate, led=LED_PERIOD_MS)
    return open_source(port, settings).source if twin is None else twin.open_reader(settings)
