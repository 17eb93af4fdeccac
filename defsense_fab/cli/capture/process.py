"""The command `defsense capture process`: videos or a recorded session to tracks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ...core.errors import DeviceError
from ...core.schema.options import changed_options
from ...workflow.sessions.options import ProcessOptions, TrackFileOptions, VideoOptions
from ..app import command
from ..output import OutputOptions, print_json, print_lines, progress_bars

if TYPE_CHECKING:
    from ...workflow.sessions.processing import ProcessedSession

_Flags = Parameter(name="*", negative=(), consume_multiple=True)
_DEFAULTS = ProcessOptions()
_NO_VIDEOS = VideoOptions()
_NO_FILE = TrackFileOptions()
_NO_OUTPUT = OutputOptions()

process = command(
    "process",
    "defsense capture process my-device/session",
    "defsense capture process --videos a.mkv b.mkv --calibration cameras.toml"
    " --tag-size 15 --dictionary 4X4_50 --out tracks.csv",
)


@process.default
def _process(
    session: Path | None = None,
    /,
    *,
    options: Annotated[ProcessOptions, _Flags] = _DEFAULTS,
    videos: Annotated[VideoOptions, _Flags] = _NO_VIDEOS,
    file: Annotated[TrackFileOptions, _Flags] = _NO_FILE,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Find the tags in the videos of calibrated cameras, and write their positions.

    The tracks have the columns frame, time (s), id, x, y, z and standard deviations sx, sy, sz
    (mm), in the frame of the first camera (--frame, --up) and at the times of the first video. Tags
    that are not visible have no row. Images of a folder, or numbered images (frame-%04d.png), are
    read as videos with --rate. The suffix of --out selects the format: .csv, .npz, .parquet, .c3d,
    .trc.

    Args:
        session: Session that 'capture record' wrote; or give --videos.
    """
    if (session is None) == (not videos.videos):
        raise DeviceError(
            "either a SESSION or --videos is required, and not both",
            code="options-incomplete",
            action="Give one of them",
        )
    if session is not None:
        _refuse(videos, "videos only, since a session has its own value")
        _process_session(session, options, file, output)
    else:
        _refuse(options, "sessions only")
        _process_videos(videos, file, output)


def _refuse(options: VideoOptions | ProcessOptions, scope: str) -> None:
    """Raise DeviceError if an option is given that does not apply."""
    for name in changed_options(options):
        flag = f"--{name.replace('_', '-')}"
        raise DeviceError(
            f"applies to {scope}",
            code="options-conflict",
            where=flag,
            action="Omit the option",
            option=flag,
        )


def _process_videos(videos: VideoOptions, file: TrackFileOptions, output: OutputOptions) -> None:
    from ...workflow.sessions.track_files import (
        DEFAULT_FILE,
        check_track_file,
        track_videos,
        write_track_file,
    )

    check_track_file(file)
    with progress_bars(output) as progress:
        result = track_videos(videos, progress)
    written = write_track_file(result.tracks, file)
    quality = dict(result.quality)
    if file.smooth is not None:
        quality["smoothed"] = file.smooth
    if output.json:
        print_json(quality | {"rate": written.rate, "gaps": written.gaps})
        return
    print_lines(
        [
            *_describe_quality(quality),
            f"Wrote:   {written.summary}",
            f"frame: {quality['frame']}",
            f"Look at: {file.out or DEFAULT_FILE}",
        ]
    )


def _process_session(
    session: Path, options: ProcessOptions, file: TrackFileOptions, output: OutputOptions
) -> None:
    from ...workflow.sessions.processing import REPORT, process_session
    from ...workflow.sessions.track_files import check_track_file, write_track_file

    if file.out is not None:
        check_track_file(file)
    elif file.smooth is not None:
        raise DeviceError(
            "applies to the output file only, and there is none",
            code="options-conflict",
            where="smooth",
            action="Give --out, or leave it out",
        )
    with progress_bars(output) as progress:
        result = process_session(session, options, progress)
    written = None if file.out is None else write_track_file(result.aligned, file)
    if output.json:
        print_json(result.quality)
        return
    print_lines(_describe_session(result))
    if written is not None:
        print_lines([f"{file.out}: {written.summary}"])
    print_lines([f"Look at: {session / REPORT}"])


def _describe_session(result: ProcessedSession) -> list[str]:
    quality = result.quality
    lines = []
    for run in quality["runs"]:
        sync = run["sync"]
        error = "unknown" if sync.get("error_ms") is None else f"{sync['error_ms']:.1f} ms"
        lines.append(
            f"{run['run']}: {run['ended']}; clocks aligned by {sync['method']}, error {error}"
        )
        lines += [f"  warning: {w}" for w in run["tracks"]["warnings"] + sync.get("notes", [])]
    lines += [f"{run['run']} was skipped: {run['why']}" for run in quality["skipped"]]
    residual = quality["residual"]["median"]
    lines.append(
        f"{quality['frames']} frames, {quality['aligned_frames']:.0%} aligned to rest by"
        f" {quality['aligned_by']}"
        + (f", residual {residual:.3f} mm" if residual is not None else "")
    )
    return lines + [f"warning: {w}" for w in quality["warnings"]]


def _describe_quality(quality: dict[str, Any]) -> list[str]:
    """Return lines on the quality of tracks."""

    def mm(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f} mm"

    q = quality
    lines = [
        f"{q['markers']} tags in {q['frames']} frames, visible in {q['seen']:.0%} of them:"
        f" {q['by_several']:.0%} by several cameras (standard deviation {mm(q['sigma_several'])}),"
        f" {q['by_one']:.0%} by one ({mm(q['sigma_one'])})",
    ]
    if q["residual"] is not None:
        lines.append(f"residual {q['residual']:.3f} px")
    if q["size"] is not None:
        lines.append(
            f"the cameras measure tags of {q['size']:.3f} mm (standard deviation"
            f" {mm(q['size_sigma'])}); {q['tag_size']:g} mm was given"
        )
    if q["impossible"]:
        lines.append(f"{q['impossible']} positions with impossible movement were removed")
    return lines + [f"warning: {w}" for w in q["warnings"]]
