"""Calibrate, arrange and check cameras that see a board: live, recorded or simulated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...capture.cameras.image_sources import Webcam
from ...capture.cameras.rig_check import MAX_ERROR_PX, Diagnosis
from ...capture.tags.tag_patterns import CharucoBoard, load_board
from ...core.camera import check_names
from ...core.errors import CaptureError, DeviceError
from ...core.guided_run import Screen
from ...core.progress import Progress, silent
from ...twin.options import TWIN, TwinCameras, is_twin
from .live_views import Opener, arrange_live, calibrate_live, check_live
from .options import ArrangementOptions, CalibrationOptions, CameraOptions, CheckOptions
from .recorded_views import (
    Calibrated,
    arrange_recorded,
    calibrate_recorded,
    check_recorded,
    report_calibrations,
)

if TYPE_CHECKING:
    from ...twin.live.board_twin import BoardTwin

MIN_CAMERAS, MAX_CAMERAS = 2, 6  # that are arranged
DEFAULT_CALIBRATION = CalibrationOptions()
DEFAULT_ARRANGEMENT = ArrangementOptions()
DEFAULT_CHECK = CheckOptions()

#: Opens the screen of live cameras; called with whether they are simulated.
OpenScreen = Callable[[bool], AbstractContextManager[Screen]]


@dataclass(frozen=True)
class CameraSources:
    """Sources of views, one per camera.

    Attributes:
        addresses: Cameras such as `0` or `/dev/video0`, names of simulated cameras, or paths of
            recordings.
        is_live: Whether the cameras are viewed now.
        twin: The simulated cameras; None for real ones.
    """

    addresses: tuple[str, ...]
    is_live: bool
    twin: BoardTwin | None = None

    @property
    def paths(self) -> list[Path]:
        """Paths of the recordings."""
        return [Path(address) for address in self.addresses]


def find_sources(addresses: Sequence[str], board: CharucoBoard) -> CameraSources:
    """Return the sources at addresses.

    Args:
        addresses: Cameras (`0`, `/dev/video0`), paths of videos or folders of images, or one
            address of simulated cameras, such as `twin:webcam,seed=1,cameras=2`.
        board: Board that simulated cameras see.

    Raises:
        DeviceError: Simulated cameras are combined with other sources (`twin-not-alone`), or
            cameras with recordings (`sources-mixed`).
    """
    if any(map(is_twin, addresses)):
        if len(addresses) > 1:
            raise DeviceError(
                f"{TWIN} stands for all cameras and cannot be combined with other sources",
                code="twin-not-alone",
                where="sources",
                action=f"Give it alone; {TWIN}:cameras=3 has three cameras",
            )
        from ...twin.live.board_twin import BoardTwin

        twin = BoardTwin(board, TwinCameras.parse(addresses[0], "sources"))
        return CameraSources(tuple(c.name for c in twin.cameras), is_live=True, twin=twin)
    live = [_is_camera(address) for address in addresses]
    if any(live) and not all(live):
        raise DeviceError(
            "cameras and recordings are mixed",
            code="sources-mixed",
            where="sources",
            action="Give either cameras (0, /dev/video0) or recordings",
        )
    return CameraSources(tuple(addresses), all(live))


def _is_camera(address: str) -> bool:
    return address.isdigit() or address.startswith("/dev/")


def camera_names(sources: CameraSources, names: Sequence[str]) -> list[str]:
    """Return the names of cameras.

    Args:
        sources: Sources of the cameras.
        names: One name per source; if empty, the names of the files, or `cam_0`, `cam_1`, ...

    Raises:
        DeviceError: There is another number of names than of sources (`camera-count-differs`).
        CaptureError: A name is not valid.
    """
    addresses = sources.addresses
    if names and len(names) != len(addresses):
        raise DeviceError(
            f"{' '.join(names)} names {len(names)} cameras, but there are {len(addresses)} sources"
            f" ({' '.join(addresses)})",
            code="camera-count-differs",
            where="name",
            action="Give one name per source, in their order",
            count=len(names),
        )
    chosen = list(names) or [
        f"cam_{k}" if _is_camera(address) else Path(address).stem
        for k, address in enumerate(addresses)
    ]
    check_names(chosen)
    return chosen


@dataclass(frozen=True)
class CameraCheck:
    """Whether the calibration of cameras is still valid, and if not, why.

    Attributes:
        diagnosis: Errors of the cameras, and the cause.
        sources: Addresses of the sources (v,), one per camera.
        board: The board.
    """

    diagnosis: Diagnosis
    sources: tuple[str, ...]
    board: CharucoBoard

    @property
    def is_valid(self) -> bool:
        """Whether the calibration is still valid."""
        return self.diagnosis.check.holds

    @property
    def source_order(self) -> tuple[str, ...] | None:
        """The sources in the order of the cameras, if they were given in another one."""
        cause = self.diagnosis.cause
        if cause is None or cause.order is None:
            return None
        return tuple(self.sources[k] for k in cause.order)

    @property
    def inaccurate_cameras(self) -> tuple[str, ...]:
        """Names of the cameras whose own views of the board do not fit."""
        errors = self.diagnosis.check.camera_errors
        pairs = zip(self.diagnosis.names, errors, strict=True)
        return tuple(name for name, error in pairs if error > MAX_ERROR_PX)

    @property
    def moved_cameras(self) -> tuple[str, ...]:
        """Names of the cameras that disagree with the others."""
        pairs = zip(self.diagnosis.names, self.diagnosis.check.disagreeing, strict=True)
        return tuple(name for name, is_disagreeing in pairs if is_disagreeing)

    @property
    def stated_square(self) -> float:
        """Side of a square of the board, mm, as its file states."""
        return self.board.scale * self.board.square

    @property
    def is_board_plausible(self) -> bool:
        """Whether a print of the board can have squares of the size that the cameras measure."""
        cause = self.diagnosis.cause
        if cause is None or cause.square is None:
            return True
        try:
            self.board.measure(cause.square)
        except CaptureError:
            return False
        return True


def calibrate_cameras(
    sources: Sequence[str],
    cameras: CameraOptions,
    options: CalibrationOptions = DEFAULT_CALIBRATION,
    *,
    open_screen: OpenScreen,
    progress: Progress = silent,
) -> list[dict[str, Any]]:
    """Calibrate the lens of each camera from its own views of a board, and store it.

    Args:
        sources: Addresses, as of `find_sources`.
        cameras: Files of the cameras and the board.
        options: Options of the calibration.
        open_screen: Opens the screen of live cameras.
        progress: Called with the progress for recordings.

    Returns:
        Plain values of each camera; `true_focal` (2,) px of simulated ones.

    Raises:
        DeviceError: The sources do not fit together.
        CaptureError: A camera cannot be calibrated.
        StorageError: The file cannot be written.
    """
    board = _load_board(cameras)
    inputs = find_sources(sources, board)
    names = camera_names(inputs, options.name)
    is_fisheye = options.lens == "fisheye"
    if not inputs.is_live:
        calibrated = calibrate_recorded(
            inputs.paths,
            names,
            board,
            cameras.calibration,
            cameras.rate,
            progress,
            fisheye=is_fisheye,
        )
        return [camera.data for camera in calibrated]
    live: list[Calibrated] = []
    opener: Opener = inputs.twin.alone if inputs.twin else Webcam
    for address, name in zip(inputs.addresses, names, strict=True):
        with open_screen(inputs.twin is not None) as screen:
            live += [
                calibrate_live(
                    address,
                    name,
                    board,
                    cameras.calibration,
                    options.views,
                    screen,
                    opener,
                    fisheye=is_fisheye,
                )
            ]
    report_calibrations(cameras.calibration, live)
    data = [camera.data for camera in live]
    for values, true in zip(data, inputs.twin.cameras if inputs.twin else (), strict=False):
        values["true_focal"] = true.focal.tolist()
    return data


def arrange_cameras(
    sources: Sequence[str],
    cameras: CameraOptions,
    options: ArrangementOptions = DEFAULT_ARRANGEMENT,
    *,
    open_screen: OpenScreen,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Find the poses of calibrated cameras from views of a board that several of them see.

    Args:
        sources: Addresses, as of `find_sources`.
        cameras: Files of the cameras and the board.
        options: Options of the arrangement.
        open_screen: Opens the screen of live cameras.
        progress: Called with the progress for recordings.

    Returns:
        Plain values for reports; `true_distances` (v,) mm of simulated cameras.

    Raises:
        DeviceError: The sources do not fit together, or there are not 2 to 6
            (`camera-count-invalid`).
        CaptureError: The cameras cannot be arranged.
        StorageError: The file cannot be written.
    """
    board = _load_board(cameras)
    inputs = find_sources(sources, board)
    count = len(inputs.addresses)
    if not MIN_CAMERAS <= count <= MAX_CAMERAS:
        raise DeviceError(
            f"{count} cameras cannot be arranged",
            code="camera-count-invalid",
            where="sources",
            action=f"Give {MIN_CAMERAS} to {MAX_CAMERAS} cameras; a single camera need not be"
            " arranged",
            count=count,
        )
    if not inputs.is_live:
        return arrange_recorded(
            inputs.paths,
            board,
            cameras.calibration,
            cameras.rate,
            progress,
            keep=options.keep_world,
        )
    opener: Opener = inputs.twin.together() if inputs.twin else Webcam
    with open_screen(inputs.twin is not None) as screen:
        data = arrange_live(
            inputs.addresses,
            board,
            cameras.calibration,
            options.views,
            screen,
            opener,
            keep=options.keep_world,
        )
    if inputs.twin is not None:
        data["true_distances"] = inputs.twin.distances
    return data


def check_cameras(
    sources: Sequence[str],
    cameras: CameraOptions,
    options: CheckOptions = DEFAULT_CHECK,
    *,
    open_screen: OpenScreen,
    progress: Progress = silent,
) -> CameraCheck:
    """Check whether the calibration of cameras is still valid.

    Args:
        sources: Addresses, as of `find_sources`.
        cameras: Files of the cameras and the board.
        options: Options of the check.
        open_screen: Opens the screen of live cameras.
        progress: Called with the progress for recordings.

    Raises:
        DeviceError: The sources do not fit together.
        CaptureError: The board is not visible, or the sources do not belong to the cameras.
    """
    board = _load_board(cameras)
    inputs = find_sources(sources, board)
    if inputs.is_live:
        opener: Opener = inputs.twin.together(again=True) if inputs.twin else Webcam
        with open_screen(inputs.twin is not None) as screen:
            diagnosis = check_live(
                inputs.addresses, board, cameras.calibration, options.views, screen, opener
            )
    else:
        diagnosis = check_recorded(inputs.paths, board, cameras.calibration, cameras.rate, progress)
    return CameraCheck(diagnosis, inputs.addresses, board)


def is_measured(board: CameraOptions) -> bool:
    """Return whether the size of a printed board was measured; otherwise lengths are inaccurate.

    Raises:
        CaptureError: The board cannot be read.
    """
    return load_board(board.board).measured is not None


def _load_board(cameras: CameraOptions) -> CharucoBoard:
    folder = cameras.calibration.parent
    if not folder.is_dir():
        raise DeviceError(
            f"the folder {folder} does not exist",
            code="folder-not-found",
            where=cameras.calibration,
            action="Create it, or choose another",
        )
    return load_board(cameras.board)
