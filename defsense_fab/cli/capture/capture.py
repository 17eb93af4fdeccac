"""The commands `defsense capture ...`."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import DeviceError, StorageError
from ..options import numbers
from ..output import progress_bars, say
from . import capture_cameras, capture_print, capture_record

if TYPE_CHECKING:
    from ..options import Bars, Commands


def add(commands: Commands) -> None:
    """Add the commands."""
    bars = progress_bars
    parent = commands.add_parser(
        "capture",
        help="cameras and printed tags: where the device's surface is, while it moves",
        description="Find out where the device's surface is while it moves, with cameras and"
        " printed tags.",
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
        help="from videos, or a recorded session, to tracks of the tags",
        description="Find the tags in the videos of calibrated cameras and write where they were:"
        " frame, time (s), id, x, y, z and standard deviations sx, sy, sz (mm), in the frame of the"
        " first camera (--frame, --up) and at the times of the first video. Tags that are not seen"
        " have no row. Images of a folder, or numbered ones (frame-%%04d.png), go as videos with"
        " --rate. The suffix of --out chooses the format: .csv, .npz, .parquet, .c3d, .trc.",
        examples=[
            "defsense capture process my-device/session",
            "defsense capture process --videos a.mkv b.mkv --calibration cameras.toml"
            " --tag-size 15 --dictionary 4X4_50 --out tracks.csv",
        ],
    )
    sub.add_argument("session", type=Path, nargs="?", metavar="SESSION",
                     help="what 'capture record' wrote; or give --videos")  # fmt: skip
    sub.add_argument("--videos", type=Path, nargs="+", metavar="FILE",
                     help="one for each camera, in the order of the calibration")  # fmt: skip
    sub.add_argument("--calibration", type=Path, default=Path("cameras.toml"), metavar="TOML",
                     help="of the cameras, as aniposelib has it (cameras.toml)")  # fmt: skip
    sub.add_argument("--tag-size", type=float, metavar="MM", help="side of a tag's black square")
    sub.add_argument("--dictionary", metavar="NAME", help="of the tags (4X4_50)")
    sub.add_argument(
        "--align", choices=("auto", "anchor", "all"), default="auto",
        help="of a session: to rest by the anchor's tags, by all, or by the anchor's where they are"
        " seen well enough (auto)",
    )  # fmt: skip
    sub.add_argument(
        "--tracks", type=Path, metavar="FILE",
        help="of a session: take markers from this file (.c3d, .trc, ...) of a motion-capture"
        " system in place of its cameras",
    )  # fmt: skip
    sub.add_argument("--from-video", action="store_true",
                     help="of a session: look for the tags anew, in its videos")  # fmt: skip
    sub.add_argument(
        "--smooth", type=float, metavar="S",
        help="smooth the tracks by parabolas over so many s (not at all)",
    )  # fmt: skip
    sub.add_argument("--out", type=Path, metavar="FILE",
                     help="(tracks.csv; of a session, a further file)")  # fmt: skip
    sub.add_argument("--rate", type=float, metavar="HZ", help="frames per second of images")
    sub.add_argument(
        "--offsets", metavar="S,S,...",
        help="what to add to each video's times, where they were not started together",
    )  # fmt: skip
    sub.add_argument(
        "--frame", choices=("camera", "world"),
        help="of videos: the first camera's (default), or that in which the calibration has the"
        " cameras, where another program (aniposelib) wrote it",
    )  # fmt: skip
    sub.add_argument(
        "--up", choices=("y", "z"),
        help="of videos: turn the first camera's frame (y down) so that this axis points upwards in"
        " its picture",
    )  # fmt: skip
    ends(sub)
    sub.set_defaults(run=lambda options: _process(options, bars))


def _add_convert(steps: Commands) -> None:
    sub = steps.add_parser(
        "convert",
        help="tracks from one format to another, as of a motion-capture system",
        description="Read tracks of markers (.csv, .npz, .parquet, .c3d, .trc) and write them in"
        " another of these formats, in mm, with missing markers missing. Labels become numbers:"
        " those at their ends, where these differ, or else their order.",
        examples=["defsense capture convert take.c3d tracks.csv"],
    )
    sub.add_argument("source", type=Path, metavar="FROM")
    sub.add_argument("out", type=Path, metavar="TO")
    sub.add_argument("--up", choices=("y", "z"), help="turn them so that this axis points upwards")
    sub.add_argument(
        "--source-up", choices=("camera", "y", "z"),
        help="for --up: what points upwards in FROM; camera: y down, z ahead, as 'process' writes",
    )  # fmt: skip
    ends(sub)
    sub.set_defaults(run=_convert)


def _convert(options: argparse.Namespace) -> int:
    from ...capture.files.formats import check_suffix, read_tracks, write_tracks
    from ...capture.files.track_conversion import AXES, change_axes

    check_suffix(options.out)
    if options.up and not options.source_up:
        raise DeviceError(
            "--up: say what points upwards in the file that is read: --source-up camera (y down, as"
            " 'process' writes), y or z"
        )
    if options.source_up and not options.up:
        raise DeviceError("--source-up is for --up: give the axis that is to point upwards, too")
    tracks, frame = read_tracks(options.source), "as it was"
    if options.up:
        tracks, frame = change_axes(tracks, options.source_up, options.up), AXES[options.up]
    written = write_tracks(options.out, tracks)
    seen = float(tracks.seen.mean()) if tracks.points.size else 0.0
    data = {"frames": written.frames, "rate": written.rate, "gaps": written.gaps,
            "markers": len(tracks.ids), "seen": seen, "frame": frame}  # fmt: skip
    if options.json:
        sys.stdout.write(json.dumps(data, indent=1) + "\n")
    else:
        say([
            f"{written.summary}; {data['markers']} markers, {seen:.0%} seen in"
            f" {len(tracks.time)} frames",
            f"frame: {frame}",
            f"Look at: {options.out}",
        ])  # fmt: skip
    return 0


def ends(sub: argparse.ArgumentParser) -> None:
    """Options that all commands end with."""
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")


def _process(options: argparse.Namespace, bars: Bars) -> int:
    from ...capture.files.formats import check_suffix, write_tracks
    from ...capture.files.track_conversion import AXES, change_axes
    from ...capture.tracking.track_filters import smooth
    from ...capture.videos.video_tracks import process_videos

    if (options.session is None) == (options.videos is None):
        raise DeviceError("give either a SESSION or --videos")
    if options.out is not None:
        check_suffix(options.out)
        _writable(options.out)
    if options.smooth is not None and not 0 < options.smooth < 1e6:
        raise DeviceError(f"--smooth {options.smooth:g}: give seconds, above 0")
    alone = "--tag-size", "--dictionary", "--rate", "--offsets", "--frame", "--up"
    if options.session is not None:
        for name in alone:
            if getattr(options, name[2:].replace("-", "_")) is not None:
                raise DeviceError(f"{name} is for --videos: a session knows its own")
        return _process_session(options, bars)
    if options.tag_size is None:
        raise DeviceError("--tag-size is missing: the side of a tag's black square, mm")
    if options.rate is not None and not 0 < options.rate <= 10_000:
        raise DeviceError(f"--rate {options.rate:g}: give frames per second, above 0")
    world = options.frame == "world"
    if world and options.up:
        raise DeviceError(
            "--up turns the first camera's frame, and only the calibration's author knows which way"
            " is up in its world; turn that with 'defsense capture convert --up --source-up'"
        )
    offsets = numbers("--offsets", options.offsets, "s") if options.offsets else None
    out = options.out or Path("tracks.csv")
    _writable(out)
    with bars(options) as progress:
        found = process_videos(
            options.videos, options.calibration, options.tag_size, options.dictionary or "4X4_50",
            rate=options.rate, offsets=offsets, world=world,
            progress=progress,
        )  # fmt: skip
    tracks, quality = found.tracks, found.quality
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
        sys.stdout.write(json.dumps(quality, indent=1) + "\n")
        return 0
    show_quality(quality)
    say([f"written: {written.summary}", f"frame: {quality['frame']}", f"Look at: {out}"])
    return 0


def _writable(out: Path) -> None:
    """Raises StorageError, before the work and not after it, where nothing can be written."""
    if not out.parent.is_dir():
        raise StorageError(f"{out}: there is no folder {out.parent}; make it, or choose another")
    if out.is_dir():
        raise StorageError(f"{out}: is a folder; give a file in it")
    if not os.access(out.parent, os.W_OK):
        raise StorageError(f"{out}: {out.parent} cannot be written to; choose another folder")


def _process_session(options: argparse.Namespace, bars: Bars) -> int:
    from ...capture.files.formats import write_tracks
    from ...capture.sessions.result_files import REPORT
    from ...capture.tracking.track_filters import smooth
    from ...workflow.sessions.processing import process_session

    with bars(options) as progress:
        found = process_session(
            options.session, anchor=options.align, video=options.from_video,
            tracks=options.tracks, progress=progress,
        )  # fmt: skip
    q = found.quality
    written = None
    if options.out is not None:
        aligned = found.aligned
        smoothed = smooth(aligned, options.smooth) if options.smooth else aligned
        written = write_tracks(options.out, smoothed)
    if options.json:
        sys.stdout.write(json.dumps(q, indent=1) + "\n")
        return 0
    lines = []
    for run in q["runs"]:
        s = run["sync"]
        error = "not known" if s.get("error_ms") is None else f"{s['error_ms']:.1f} ms"
        lines.append(f"{run['run']}: {run['ended']}; clocks by {s['method']}, error {error}")
        lines += [f"  warning: {w}" for w in run["tracks"]["warnings"] + s.get("notes", [])]
    lines += [f"{s['run']} was left out: {s['why']}" for s in q["skipped"]]
    residual = q["residual"]["median"]
    lines += [
        f"{q['frames']} frames, {q['aligned_frames']:.0%} aligned to rest by {q['aligned_by']}"
        + (f", residual {residual:.3f} mm" if residual is not None else ""),
        *(f"warning: {w}" for w in q["warnings"]),
        *([] if written is None else [f"{options.out}: {written.summary}"]),
        f"Look at: {options.session / REPORT}",
    ]
    say(lines)
    return 0


def show_quality(q: dict[str, Any]) -> None:
    """What tracks are worth, in lines."""

    def mm(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f} mm"

    lines = [
        f"{q['markers']} tags in {q['frames']} frames, seen in {q['seen']:.0%} of them:"
        f" {q['by_several']:.0%} by several cameras (standard deviation {mm(q['sigma_several'])}),"
        f" {q['by_one']:.0%} by one ({mm(q['sigma_one'])})",
    ]
    if q["residual"] is not None:
        lines.append(f"residual {q['residual']:.3f} px")
    if q["size"] is not None:
        lines.append(
            f"the tags' sides are {q['size']:.3f} mm to these cameras (standard deviation"
            f" {mm(q['size_sigma'])}), {q['tag_size']:g} mm was told"
        )
    if q["impossible"]:
        lines.append(f"{q['impossible']} places were taken out: nothing moves like that")
    lines += [f"warning: {w}" for w in q["warnings"]]
    say(lines)
