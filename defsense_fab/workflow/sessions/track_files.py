"""Tracks of markers as files: those of videos and sessions, and conversions between formats."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

from ...capture.files.formats import check_suffix, read_track_file, write_tracks
from ...capture.files.track_conversion import AXES, WrittenFrames, change_axes
from ...capture.tracking.track_filters import smooth
from ...capture.videos.video_tracks import VideoTracks, process_videos
from ...core.errors import CaptureError, StorageError
from ...core.markers import Tracks
from ...core.progress import Progress, silent
from .options import ConversionOptions, TrackFileOptions, VideoOptions

#: File of the tracks of videos, in the current folder.
DEFAULT_FILE = Path("tracks.csv")
NO_CONVERSION = ConversionOptions()


@dataclass(frozen=True)
class ConvertedTracks:
    """Tracks that were converted to another format.

    Attributes:
        tracks: The tracks.
        written: The frames of the file.
        frame: Frame of reference of the file.
        notes: What was left out of the source, or assumed.
    """

    tracks: Tracks
    written: WrittenFrames
    frame: str
    notes: tuple[str, ...] = ()

    @property
    def visible_share(self) -> float:
        """Share of the positions that are not missing."""
        return float(self.tracks.visible.mean()) if self.tracks.points.size else 0.0


def track_videos(options: VideoOptions, progress: Progress = silent) -> VideoTracks:
    """Locate tags in videos of calibrated cameras.

    Args:
        options: The videos, and how their tags are located.
        progress: Receives progress.

    Returns:
        The tracks; `quality` states their frame of reference.

    Raises:
        CaptureError: An option is missing or does not fit (`options-incomplete`,
            `options-conflict`), files do not belong together, or no tag can be located.
    """
    if options.tag_size is None:
        raise CaptureError(
            "is required for videos",
            code="options-incomplete",
            where="tag_size",
            action="Give the side of a tag's black square in mm",
            option="tag_size",
        )
    is_world = options.frame == "world"
    if is_world and options.up:
        raise CaptureError(
            "rotates the first camera's frame; the upward axis of the calibration's world is"
            " unknown",
            code="options-conflict",
            where="up",
            action="Rotate the tracks with 'defsense capture convert' instead",
            option="up",
        )
    result = process_videos(
        options.videos,
        options.calibration,
        options.tag_size,
        options.dictionary,
        rate=options.rate,
        offsets=options.offsets,
        world=is_world,
        progress=progress,
    )
    if is_world:
        return result
    tracks = change_axes(result.tracks, "camera", options.up) if options.up else result.tracks
    frame = f"{result.quality['frame']}, {AXES[options.up or 'camera']}"
    return replace(result, tracks=tracks, quality={**result.quality, "frame": frame})


def check_track_file(options: TrackFileOptions) -> None:
    """Check that tracks can be written to the file `out`, before the long work starts.

    Raises:
        CaptureError: The format is unknown.
        StorageError: The folder does not exist (`folder-not-found`) or is not writable
            (`folder-not-writable`), or the path is a folder (`not-a-file`).
    """
    path = _path(options)
    check_suffix(path)
    if not path.parent.is_dir():
        raise StorageError(
            f"the folder {path.parent} does not exist",
            code="folder-not-found",
            where=path,
            action="Create it, or choose another",
            path=path,
        )
    if path.is_dir():
        raise StorageError(
            "is a folder",
            code="not-a-file",
            where=path,
            action="Give a file in it",
            path=path,
        )
    if not os.access(path.parent, os.W_OK):
        raise StorageError(
            f"the folder {path.parent} is not writable",
            code="folder-not-writable",
            where=path,
            action="Choose another folder",
            path=path,
        )


def write_track_file(tracks: Tracks, options: TrackFileOptions) -> WrittenFrames:
    """Write tracks to the file `out`, smoothed if the options say so.

    Raises:
        CaptureError: The format is unknown.
        StorageError: The file cannot be written.
    """
    if options.smooth is not None:
        tracks = smooth(tracks, options.smooth)
    return write_tracks(_path(options), tracks)


def _path(options: TrackFileOptions) -> Path:
    return DEFAULT_FILE if options.out is None else options.out


def convert_tracks(
    source: Path, out: Path, options: ConversionOptions = NO_CONVERSION
) -> ConvertedTracks:
    """Read tracks from a file and write them to another.

    Args:
        source: File to read.
        out: File to write; its suffix selects the format.
        options: Unit of the source, and axis that points upwards afterwards.

    Raises:
        CaptureError: A file cannot be read or written in its format, or only one of the two axes
            is given (`options-incomplete`).
        StorageError: The file cannot be written.
    """
    check_suffix(out)
    if options.up and not options.source_up:
        raise CaptureError(
            "the upward axis of the file is unknown",
            code="options-incomplete",
            where="up",
            action="Give source_up: camera (y down, as 'process' writes), y or z",
            option="source_up",
        )
    if options.source_up and not options.up:
        raise CaptureError(
            "has no effect without an axis that will point upwards",
            code="options-incomplete",
            where="source_up",
            action="Give up",
            option="up",
        )
    file = read_track_file(source, options.unit)
    tracks, frame = file.tracks, "unchanged"
    if options.up and options.source_up:
        tracks, frame = change_axes(tracks, options.source_up, options.up), AXES[options.up]
    return ConvertedTracks(tracks, write_tracks(out, tracks), frame, file.notes)
