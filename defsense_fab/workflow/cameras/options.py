"""Options of the calibration, the arrangement and the check of cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from ...core.errors import CaptureError
from ...core.schema.options import check_options

#: Calibration of the cameras, in the current folder.
CALIBRATION_FILE = Path("cameras.toml")
MAX_VIEWS = 80  # of a live camera
Views = Annotated[int, Meta(ge=1, le=MAX_VIEWS)]
FrameRate = Annotated[float, Meta(ge=1e-3, le=10_000)]  # Hz


@dataclass(frozen=True)
class CameraOptions:
    """Files of cameras that see a board.

    Attributes:
        board: Set the folder that 'capture board' wrote, or its board.json.
        calibration: Set the calibration file of the cameras.
        rate: Set the frame rate of images in Hz.
    """

    board: Path
    calibration: Path = CALIBRATION_FILE
    rate: FrameRate | None = None

    def __post_init__(self) -> None:
        check_options(self, CaptureError)


@dataclass(frozen=True)
class CalibrationOptions:
    """Options of the calibration of cameras.

    Attributes:
        name: Set the names of the cameras, one per SOURCE (default: the files' names, or cam_0,
            cam_1).
        views: Set the number of views that a live camera takes.
        lens: Choose the lens model: pinhole, or fisheye for lenses that show more than 110 degrees.
    """

    name: tuple[str, ...] = ()
    views: Views = 25
    lens: Literal["pinhole", "fisheye"] = "pinhole"

    def __post_init__(self) -> None:
        check_options(self, CaptureError)


@dataclass(frozen=True)
class ArrangementOptions:
    """Options of the arrangement of cameras.

    Attributes:
        views: Set the number of views that live cameras take together.
        keep_world: Keep the first camera where the calibration file has it, if another program
            (aniposelib) wrote it (default: it becomes the origin).
    """

    views: Views = 15
    keep_world: bool = False

    def __post_init__(self) -> None:
        check_options(self, CaptureError)


@dataclass(frozen=True)
class CheckOptions:
    """Options of the check of cameras.

    Attributes:
        views: Set the number of views that live cameras take.
    """

    views: Views = 3

    def __post_init__(self) -> None:
        check_options(self, CaptureError)
