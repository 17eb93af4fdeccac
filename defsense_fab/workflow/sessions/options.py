"""Options of recordings, of their processing, and of files of tracks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from ...capture.files.length_units import LengthUnit
from ...core.errors import CaptureError
from ...core.schema.options import check_options
from ..cameras.options import CALIBRATION_FILE as CALIBRATION_FILE
from ..cameras.options import FrameRate
from ..tags.options import TAG_DICTIONARY

Resistance = Annotated[float, Meta(ge=1e-3, le=1e9)]  # ohm
Axis = Literal["y", "z"]


@dataclass(frozen=True)
class RecordOptions:
    """Options of a guided recording.

    Attributes:
        calibration: Set the calibration of the cameras (default: cameras.toml; not needed for a
            twin).
        markers: Set the folder that 'capture markers' wrote, or its markers.json (default: markers,
            in the device folder).
        out: Set the session folder; an incomplete session is resumed (default: session, in the
            device folder).
        rounds: Set the number of rounds through all poses.
        seconds: Set the time for each pose in s.
        free: Set the time of free movement at the end of each round in s.
        rest: Set the time of rest at the start and the end in s.
        reference: Set the reference resistors of the voltage dividers in ohm, or one for all
            (default: those of the assembly guide, that of a twin, or 2200).
        rate: Set the sampling rate in Hz.
        unit: Set the name of the unit, if several devices are built alike.
        video: Keep the pictures too: lossless, about 10 MB per second.
    """

    calibration: Path | None = None
    markers: Path | None = None
    out: Path | None = None
    rounds: Annotated[int, Meta(ge=1, le=100)] = 2
    seconds: Annotated[float, Meta(ge=1, le=600)] = 8.0
    free: Annotated[float, Meta(ge=0, le=600)] = 15.0
    rest: Annotated[float, Meta(ge=1, le=60)] = 4.0
    reference: tuple[Resistance, ...] | None = None
    rate: Annotated[int, Meta(ge=1, le=500)] = 50
    unit: str | None = None
    video: bool = False

    def __post_init__(self) -> None:
        check_options(self, CaptureError)


@dataclass(frozen=True)
class ProcessOptions:
    """Options of the processing of a recorded session.

    Attributes:
        align: Choose how the session is aligned to rest: by the anchor's tags, by all tags, or by
            the anchor's where enough of them are visible (auto).
        tracks: Read the markers from this file (.c3d, .trc, ...) of a motion-capture system instead
            of the session's cameras.
        tracks_unit: Set the unit of the positions in `tracks`, for a file that does not state it.
        from_video: Detect the tags again in the session's videos.
    """

    align: Literal["auto", "anchor", "all"] = "auto"
    tracks: Path | None = None
    tracks_unit: LengthUnit | None = None
    from_video: bool = False

    def __post_init__(self) -> None:
        check_options(self, CaptureError)
        if self.tracks_unit is not None and self.tracks is None:
            raise CaptureError(
                "has no effect without a file of tracks",
                code="options-conflict",
                where="tracks_unit",
                action="Omit it, or give tracks",
                option="tracks_unit",
            )


@dataclass(frozen=True)
class VideoOptions:
    """Videos of calibrated cameras, and how their tags are located.

    Attributes:
        videos: Set the videos, one per camera, in the order of the calibration.
        calibration: Set the calibration of the cameras, in the format of aniposelib.
        tag_size: Set the side of a tag's black square in mm.
        dictionary: Set the dictionary of the tags.
        rate: Set the frame rate of images in Hz.
        offsets: Add these times in s to those of each video, if they were not started together.
        frame: Choose the frame of reference: the first camera's, or that of the calibration's
            world, if another program (aniposelib) wrote it.
        up: Rotate the first camera's frame (y down) so that this axis points upwards in its
            picture.
    """

    videos: tuple[Path, ...] = ()
    calibration: Path = CALIBRATION_FILE
    tag_size: float | None = None
    dictionary: str = TAG_DICTIONARY
    rate: FrameRate | None = None
    offsets: tuple[float, ...] | None = None
    frame: Literal["camera", "world"] = "camera"
    up: Axis | None = None

    def __post_init__(self) -> None:
        check_options(self, CaptureError)


@dataclass(frozen=True)
class TrackFileOptions:
    """A file that tracks are written to.

    Attributes:
        out: Set the output file; its suffix selects the format (default: tracks.csv; for a session,
            no additional file).
        smooth: Smooth the tracks with parabolas over this time in s (default: no smoothing).
    """

    out: Path | None = None
    smooth: Annotated[float, Meta(ge=1e-3, le=1e6)] | None = None

    def __post_init__(self) -> None:
        check_options(self, CaptureError)


@dataclass(frozen=True)
class ConversionOptions:
    """Options of a conversion of tracks.

    Attributes:
        unit: Set the unit of the positions, for a file that does not state it.
        up: Rotate the tracks so that this axis points upwards.
        source_up: Set what points upwards in the file that is read, for a rotation: y, z, or camera
            (y down, z forwards, as 'process' writes).
    """

    unit: LengthUnit | None = None
    up: Axis | None = None
    source_up: Literal["camera", "y", "z"] | None = None

    def __post_init__(self) -> None:
        check_options(self, CaptureError)
