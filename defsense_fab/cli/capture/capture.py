"""Commands `defsense capture ...`: markers, cameras, recording, tracks."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import DeviceError, StorageError
from ..options import add_output_options, parse_numbers
from ..output import print_json, print_lines, progress_bars
from . import capture_cameras, capture_print, capture_record

if TYPE_CHECKING:
    from ..options import Bars, Commands


def add(commands: Commands) -> None:
    """Add `capture` and its steps."""
    bars = progress_bars
    parent = commands.add_parser(
        "capture",
        help="Measure the device's surface with cameras and printed tags",
        description="Measure where the device's surface is while it moves, with cameras and "
        "printed tags.",
    )
    steps = parent.add_subparsers(dest="step", required=True, metavar="STEP")
    capture_print.add(steps, bars)
    capture_cameras.add(steps, bars)
    capture_record.add(steps)
    _add_process(steps, bars)
    _add_convert(steps)


def _add_process(steps: Commands, bars: Bars) -> None:
    sub = steps.add_parser(
        "process",
        help="Convert videos, or a recorded session, to tracks of the tags",
        description="Find the tags in the videos of calibrated cameras and write their positions: "
        "frame, time (s), id, x, y, z and standard deviations sx, sy, sz (mm), in the "
        "frame of the first camera (--frame, --up) and at the times of the first "
        "video. Tags that are not visible have no row. Images of a folder, or numbered"
        " images (frame-%04d.png), are read as videos with --rate. The suffix of --out"
        " selects the format: .csv, .npz, .parquet, .c3d, .trc.",
        examples=[
            "defsense capture process my-device/session",
            "defsense capture process --videos a.mkv b.mkv --calibration cameras.toml"
            " --tag-size 15 --dictionary 4X4_50 --out tracks.csv",
        ],
    )
    sub.add_argument(
        "session",
        type=Path,
        nargs="?",
        metavar="SESSION",
        help="Session that 'capture record' wrote; or give --videos",
    )
    sub.add_argument(
        "--videos",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="Set the videos, one per camera, in the order of the calibration",
    )
    sub.add_argument(
        "--calibration",
        type=Path,
        default=Path("cameras.toml"),
        metavar="TOML",
        help="Set the calibration of the cameras, in the format of aniposelib (default: "
        "cameras.toml)",
    )
    sub.add_argument(
        "--tag-size", type=float, metavar="MM", help="Set the side of a tag's black square in mm"
    )
    sub.add_argument(
        "--dictionary", metavar="NAME", help="Set the dictionary of the tags (default: 4X4_50)"
    )
    sub.add_argument(
        "--align",
        choices=("auto", "anchor", "all"),
        default="auto",
        help="Choose how a session is aligned to rest: by the anchor's tags, by all tags, "
        "or by the anchor's where enough of them are visible (auto, default)",
    )
    sub.add_argument(
        "--tracks",
        type=Path,
        metavar="FILE",
        help="Read the markers of a session from this file (.c3d, .trc, ...) of a "
        "motion-capture system instead of its cameras",
    )
    sub.add_argument(
        "--from-video", action="store_true", help="Detect the tags of a session again in its videos"
    )
    sub.add_argument(
        "--smooth",
        type=float,
        metavar="S",
        help="Smooth the tracks with parabolas over this time in s (default: no smoothing)",
    )
    sub.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="Set the output file (default: tracks.csv; for a session, no additional file)",
    )
    sub.add_argument("--rate", type=float, metavar="HZ", help="Set the frame rate of images in Hz")
    sub.add_argument(
        "--offsets",
        metavar="S,S,...",
        help="Add these times in s to those of each video, if they were not started together",
    )
    sub.add_argument(
        "--frame",
        choices=("camera", "world"),
        help="Choose the frame of reference for videos: the first camera's (default), or "
        "that of the calibration's world, if another program (aniposelib) wrote it",
    )
    sub.add_argument(
        "--up",
        choices=("y", "z"),
        help="Rotate the first camera's frame (y down) so that this axis points upwards in "
        "its picture; for videos",
    )
    add_output_options(sub)
    sub.set_defaults(run=lambda options: _process(options, bars))


def _add_convert(steps: Commands) -> None:
    sub = steps.add_parser(
        "convert",
        help="Convert tracks between formats, such as those of motion-capture systems",
        description="Read tracks of markers (.csv, .npz, .parquet, .c3d, .trc) and write them in "
        "another of these formats, in mm; missing markers stay missing. Labels become "
        "numbers: the numbers at their ends if these differ, or else their order.",
        examples=["defsense capture convert take.c3d tracks.csv"],
    )
    sub.add_argument("source", type=Path, metavar="FROM", help="Tracks to read")
    sub.add_argument("out", type=Path, metavar="TO", help="Tracks to write")
    sub.add_argument(
        "--up", choices=("y", "z"), help="Rotate the tracks so that this axis points upwards"
    )
    sub.add_argument(
        "--source-up",
        choices=("camera", "y", "z"),
        help="Set what points upwards in FROM, for --up: y, z, or camera (y down, z "
        "forwards, as 'process' writes)",
    )
    add_output_options(sub)
    sub.set_defaults(run=_convert)


def _convert(options: argparse.Namespace) -> int:
    from ...capture.files.formats import check_suffix, read_tracks, write_tracks
    from ...capture.files.track_conversion import AXES, change_axes

    check_suffix(options.out)
    if options.up and not options.source_up:
        raise DeviceError(
            "the upward axis of the file is unknown",
            code="options-incomplete",
            where="--up",
            action="Give --source-up camera (y down, as 'process' writes), y or z",
            option="--source-up",
        )
    if options.source_up and not options.up:
        raise DeviceError(
            "applies to --up only",
            code="options-incomplete",
            where="--source-up",
            action="Give --up with the axis that will point upwards",
            option="--up",
        )
    tracks, frame = read_tracks(options.source), "unchanged"
    if options.up:
        tracks, frame = change_axes(tracks, options.source_up, options.up), AXES[options.up]
    written = write_tracks(options.out, tracks)
    visible = float(tracks.visible.mean()) if tracks.points.size else 0.0
    data = {"frames": written.frames, "rate": written.rate, "gaps": written.gaps,
            "markers": len(tracks.ids), "seen": visible, "frame": frame}  # fmt: skip
    if options.json:
        print_json(data)
    else:
        print_lines([
            f"{written.summary}; {data['markers']} markers, {visible:.0%} visible in"
            f" {len(tracks.time)} frames",
            f"frame: {frame}",
            f"Look at: {options.out}",
        ])  # fmt: skip
    return 0


def _process(options: argparse.Namespace, bars: Bars) -> int:
    from ...capture.files.formats import check_suffix, write_tracks
    from ...capture.files.track_conversion import AXES, change_axes
    from ...capture.tracking.track_filters import smooth
    from ...capture.videos.video_tracks import process_videos

    if (options.session is None) == (options.videos is None):
        raise DeviceError(
            "either a SESSION or --videos is required, and not both",
            code="sources-missing",
            action="Give one of them",
        )
    if options.out is not None:
        check_suffix(options.out)
        _check_writable(options.out)
    if options.smooth is not None and not 0 < options.smooth < 1e6:
        raise DeviceError(
            f"{options.smooth:g} is out of range",
            code="out-of-range",
            where="--smooth",
            action="Give seconds, above 0",
            value=options.smooth,
        )
    video_options = "--tag-size", "--dictionary", "--rate", "--offsets", "--frame", "--up"
    if options.session is not None:
        for name in video_options:
            if getattr(options, name[2:].replace("-", "_")) is not None:
                raise DeviceError(
                    "applies to --videos only, since a session has its own value",
                    code="options-conflict",
                    where=name,
                    action="Omit the option",
                    option=name,
                )
        return _process_session(options, bars)
    if options.tag_size is None:
        raise DeviceError(
            "is required for --videos",
            code="options-incomplete",
            where="--tag-size",
            action="Give the side of a tag's black square in mm",
            option="--tag-size",
        )
    if options.rate is not None and not 0 < options.rate <= 10_000:
        raise DeviceError(
            f"{options.rate:g} is out of range",
            code="out-of-range",
            where="--rate",
            action="Give frames per second, above 0",
            value=options.rate,
        )
    world = options.frame == "world"
    if world and options.up:
        raise DeviceError(
            "rotates the first camera's frame and cannot be combined with --frame world, whose"
            " upward axis is unknown",
            code="options-conflict",
            where="--up",
            action="Rotate the tracks with 'defsense capture convert --up --source-up'",
            option="--up",
        )
    offsets = parse_numbers("--offsets", options.offsets, "s") if options.offsets else None
    out = options.out or Path("tracks.csv")
    _check_writable(out)
    with bars(options) as progress:
        result = process_videos(
            options.videos, options.calibration, options.tag_size, options.dictionary or "4X4_50",
            rate=options.rate, offsets=offsets, world=world,
            progress=progress,
        )  # fmt: skip
    tracks, quality = result.tracks, result.quality
    if options.up:
        tracks = change_axes(tracks, "camera", options.up)
    if not world:
        quality["frame"] += f", {AXES[options.up or 'camera']}"
    if options.smooth is not None:
        tracks = smooth(tracks, options.smooth)
        quality = {**quality, "smoothed": options.smooth}
    written = write_tracks(out, tracks)
    if options.json:
        quality |= {"rate": written.rate, "gaps": written.gaps}
        print_json(quality)
        return 0
    print_quality(quality)
    print_lines([f"Wrote:   {written.summary}", f"frame: {quality['frame']}", f"Look at: {out}"])
    return 0


def _check_writable(out: Path) -> None:
    """Raise StorageError if a file cannot be written, before the long work starts."""
    if not out.parent.is_dir():
        raise StorageError(
            f"the folder {out.parent} does not exist",
            code="folder-not-result",
            where=out,
            action="Create it, or choose another",
            path=out,
        )
    if out.is_dir():
        raise StorageError(
            "is a folder",
            code="not-a-file",
            where=out,
            action="Give a file in it",
            path=out,
        )
    if not os.access(out.parent, os.W_OK):
        raise StorageError(
            f"the folder {out.parent} is not writable",
            code="folder-not-writable",
            where=out,
            action="Choose another folder",
            path=out,
        )


def _process_session(options: argparse.Namespace, bars: Bars) -> int:
    from ...capture.files.formats import write_tracks
    from ...capture.sessions.results import REPORT
    from ...capture.tracking.track_filters import smooth
    from ...workflow.sessions.processing import process_session

    with bars(options) as progress:
        result = process_session(
            options.session, anchor=options.align, video=options.from_video,
            tracks=options.tracks, progress=progress,
        )  # fmt: skip
    q = result.quality
    written = None
    if options.out is not None:
        aligned = result.aligned
        smoothed = smooth(aligned, options.smooth) if options.smooth else aligned
        written = write_tracks(options.out, smoothed)
    if options.json:
        print_json(q)
        return 0
    lines = []
    for run in q["runs"]:
        s = run["sync"]
        error = "unknown" if s.get("error_ms") is None else f"{s['error_ms']:.1f} ms"
        lines.append(
            f"{run['run']}: {run['ended']}; clocks aligned by {s['method']}, error {error}"
        )
        lines += [f"  warning: {w}" for w in run["tracks"]["warnings"] + s.get("notes", [])]
    lines += [f"{s['run']} was skipped: {s['why']}" for s in q["skipped"]]
    residual = q["residual"]["median"]
    lines += [
        f"{q['frames']} frames, {q['aligned_frames']:.0%} aligned to rest by {q['aligned_by']}"
        + (f", residual {residual:.3f} mm" if residual is not None else ""),
        *(f"warning: {w}" for w in q["warnings"]),
        *([] if written is None else [f"{options.out}: {written.summary}"]),
        f"Look at: {options.session / REPORT}",
    ]
    print_lines(lines)
    return 0


def print_quality(q: dict[str, Any]) -> None:
    """Print the quality of tracks."""

    def mm(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f} mm"

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
    lines += [f"warning: {w}" for w in q["warnings"]]
    print_lines(lines)
