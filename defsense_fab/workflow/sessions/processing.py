"""From a recorded session to tracks in the rest frame, with the signals at the same times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...capture.cameras.image_sources import Video, measure_timing
from ...capture.cameras.rig_file import Rig
from ...capture.clocks.clock_fit import fit_clocks
from ...capture.clocks.synchronization import synchronize_by_motion
from ...capture.files.formats import read_tracks, write_tracks
from ...capture.files.track_conversion import frame_grid
from ...capture.readout.recording import read_recording
from ...capture.sessions.camera_recorder import VIDEO_RATE_HZ
from ...capture.sessions.recorded_tags import CameraRecording, read_camera_tags
from ...capture.sessions.rest_frame import align_with_rest
from ...capture.sessions.results import (
    REPORT,
    TRACKS,
    ClockPart,
    ProcessedSession,
    quantiles,
    write_results,
)
from ...capture.sessions.session import (
    BOARD,
    CAMERAS,
    CaptureSession,
    load,
    read_log,
    rest_frames,
    run_ending,
    step_starts,
)
from ...capture.sessions.signals import (
    marker_distances,
    resistances,
    resistances_at,
    rest_resistances,
    restarts,
    sync_record,
    synchronize_signals,
)
from ...capture.tracking.observations import FrameTags
from ...capture.videos.video_detection import VideoDetections, detect_markers
from ...capture.videos.video_tracks import VideoTracks, assemble
from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.progress import Progress, silent
from ...core.version import __version__
from ...report.session_page import lengths, write_report
from ...sensing.response import relative_change

_PAUSE = 1.0  # s, between runs, in the tracks' time
_ALONE = 5.0  # s without tags that are worth a word


@dataclass(frozen=True)
class _ProcessedRun:
    processed: VideoTracks
    ohm: Float
    rest: Bool
    sync: dict[str, Any]
    told: dict[str, Any]
    clocks: list[ClockPart]
    steps: list[tuple[float, str]]


def process_session(
    folder: Path, *, anchor: str = "auto", video: bool = False, tracks: Path | None = None,
    progress: Progress = silent,
) -> ProcessedSession:  # fmt: skip
    """Process all runs of a session and write the results into its folder. `anchor`: align by the
    anchor's markers, by all, or by the anchor's where they are seen well enough (auto); `video`:
    look for the tags anew in the recorded videos; `tracks`: a file of a motion-capture system that
    takes the cameras' place, for a session of one run. Raises CaptureError where nothing can be
    made of it."""
    if anchor not in ("auto", "anchor", "all"):
        raise CaptureError(f"--align {anchor}: choose auto, anchor or all")
    session = load(folder)
    if tracks is not None and len(session.runs) != 1:
        raise CaptureError(
            f"{folder}: has {len(session.runs)} runs; a file of tracks belongs to a session of one"
        )
    if not session.runs:
        raise CaptureError(f"{folder}: nothing was recorded yet; run 'defsense capture record'")
    runs, skipped = [], []
    for k, run in enumerate(session.runs):
        done = 0.9 * k / len(session.runs)
        progress("session", done, f"reading {run.name}")
        try:
            if tracks is None:
                runs.append(_run(session, run, video=video, progress=progress))
            else:
                runs.append(_captured(session, run, tracks))
        except CaptureError as error:
            skipped.append({"run": run.name, "why": str(error), "ended": run_ending(run)})
    if not runs:
        why = "; ".join(f"{s['run']}: {s['why']}" for s in skipped)
        raise CaptureError(f"{folder}: no run can be used: {why}")
    progress("session", 0.9, "laying the tracks onto the rest pose")
    result = _join(session, runs, skipped, anchor)
    progress("session", 0.95, "writing tracks, signals and the report")
    write_tracks(folder / TRACKS, result.tracks)
    write_results(folder, session, result)
    write_report(folder / REPORT, session, result)
    progress("session", 1.0, "done")
    return result


def _run(session: CaptureSession, run: Path, *, video: bool, progress: Progress) -> _ProcessedRun:
    """One run by itself: its clocks are its own."""
    events = read_log(run)
    # Before the tags, as the text takes more memory than what is read from it.
    recording = read_recording(run / BOARD) if (run / BOARD).exists() else None
    rig, cameras, absent = _recorded(session, run)
    start = min(int(c.time[0]) for c in cameras)
    watched, lacking = [], {}
    for camera, seen in zip(rig.cameras, cameras, strict=True):
        time, tags = (seen.time - start) / 1e9, seen.tags
        if video:
            tags, lacks = _again(session, run, camera, seen.frame, progress)
            if lacks:
                lacking[camera.name] = lacks
        watched.append(VideoDetections(time, tags, measure_timing(time), 0))
    names = [f"{run.name}/{c.name}" for c in rig.cameras]
    try:
        processed = assemble(
            watched, rig, session.markers.size, names, None, progress, session.rig.cameras[0],
            session.markers.ids[session.markers.anchor],
        )  # fmt: skip
    except CaptureError as error:
        raise CaptureError("; ".join([str(error), *absent])) from None
    processed.quality["warnings"] += absent + [
        f"{run.name}/{name}.mkv lacks {n} of the recorded frames: no tags are known in those"
        for name, n in lacking.items()
    ]
    shift = processed.quality["offsets"]
    tracks = processed.tracks
    ohm = np.full((len(tracks.time), len(session.channels)), np.nan)
    told: dict[str, Any] = {"method": "none"}
    lost, clocks = list[str](), list[ClockPart]()
    if recording is not None:
        ohm, told, clocks = synchronize_signals(session, recording, cameras, start, shift, tracks)
        if recording.damaged_lines:
            lost.append(f"lines of {run.name}/{BOARD}: {recording.damaged_lines}")
    rest = rest_frames(events, tracks.time, start)
    cut = sum(c.cut for c in cameras)
    lost += [f"lines of {n}'s files: {c.cut}" for n, c in zip(names, cameras, strict=True) if c.cut]
    if lost:
        processed.quality["warnings"].append(f"cut or damaged, and left out: {', '.join(lost)}")
    processed.quality["warnings"] += _ends_early(names, watched)
    return _ProcessedRun(
        processed, ohm, rest, told, {"run": run.name, "ended": run_ending(run), "cut": cut}, clocks,
        step_starts(events, start),
    )  # fmt: skip


def _recorded(session: CaptureSession, run: Path) -> tuple[Rig, list[CameraRecording], list[str]]:
    """The cameras that recorded something in a run, what each did, and warnings of the others."""
    if not session.rig.cameras:
        raise CaptureError(
            f"no picture was recorded: {session.folder / CAMERAS} is missing, which says how the"
            " cameras see and where they stand; copy that file there, or give the tracks of a"
            " motion-capture system with --tracks"
        )
    kept, cameras, absent = [], [], []
    for camera in session.rig.cameras:
        try:
            seen = read_camera_tags(run, camera.name, session.markers.ids)
            if not len(seen.time):
                raise CaptureError(f"no picture was recorded by {camera.name}")
        except CaptureError as error:
            absent.append(f"{run.name} is processed without {camera.name}: {error}")
            continue
        kept.append(camera)
        cameras.append(seen)
    if not kept:
        raise CaptureError("no camera's recording can be used: " + "; ".join(absent))
    return replace(session.rig, cameras=tuple(kept)), cameras, absent


def _captured(session: CaptureSession, run: Path, path: Path) -> _ProcessedRun:
    """A run whose markers are those of another system, in step by how they move."""
    tracks = read_tracks(path)
    known = np.isin(tracks.ids, session.markers.ids)
    if known.sum() < 3:
        have, want = (", ".join(map(str, i.tolist())) for i in (tracks.ids, session.markers.ids))
        raise CaptureError(
            f"{path}: its markers are {have}, the device's are {want}; name them by these numbers"
            " (tag_1, tag_2, ...)"
        )
    tracks = Tracks(
        tracks.time, tracks.ids[known], tracks.points[:, known], tracks.sigma[:, known],
        tracks.frame,
    )  # fmt: skip
    recording = read_recording(run / BOARD)
    device = recording.device_us / 1e6
    ohm = resistances(session, recording)
    sync = synchronize_by_motion(tracks.time, marker_distances(tracks), device, ohm)
    about_sync = sync_record(sync, [])
    if restarts(recording):
        about_sync["error_ms"] = None
        about_sync["notes"] = [
            "the read-out board began anew in this run: signals from then on may be tens of ms"
            " off; record it again"
        ]
    quality: dict[str, Any] = {"warnings": [], "by_several": float(tracks.visible.mean()),
                               "by_one": 0.0, "impossible": 0}  # fmt: skip
    none = np.zeros(0, np.int64), np.empty((len(tracks.time), 0, 4, 3), np.float32)
    processed = VideoTracks(tracks, 2 * tracks.visible.astype(np.int8), quality, *none)
    at = resistances_at(sync.to_device(tracks.time), device, ohm)
    arrival = fit_clocks(device, recording.host_ns / 1e9)
    events = read_log(run)
    rest = rest_frames(events, arrival.to_host(sync.to_device(tracks.time)))
    shown = step_starts(events)
    heard = (np.array([at for at, _ in shown]) - arrival.offset) / (1 + arrival.drift)
    steps = [(float(t), name) for t, (_, name) in zip(sync.to_camera(heard), shown, strict=True)]
    about = {
        "run": run.name,
        "ended": run_ending(run),
        "cut": recording.damaged_lines,
        "tracks_of": str(path),
    }
    clocks = [ClockPart(slice(0, len(device)), sync.offset, sync.drift)]
    return _ProcessedRun(processed, at, rest, about_sync, about, clocks, steps)


def _ends_early(names: Sequence[str], watched: Sequence[VideoDetections]) -> list[str]:
    """Warnings of cameras that see no tag for long at the end: moved, or their files cut off."""
    out = []
    for name, w in zip(names, watched, strict=True):
        seen = np.flatnonzero(w.tags.count)
        left = w.time[-1] - w.time[seen[-1]] if len(seen) else 0.0
        if left > _ALONE:
            out.append(
                f"{name}: shows no tag in its last {left:.0f} s; was it covered, or is its file"
                " damaged?"
            )
    return out


def _again(
    session: CaptureSession, run: Path, camera: Camera, frame: Int, progress: Progress
) -> tuple[FrameTags, int]:
    """The device's tags in the frames of the numbers `frame` (f,) from the run's video, and how
    many of all it lacks: a video that was cut off, or that a full disk has left gaps in, says by
    its times which it has."""
    path = run / f"{camera.name}.mkv"
    if not path.exists():
        raise CaptureError(f"{path}: there is no video; the session was recorded without --video")
    time, found = detect_markers(Video(path), camera, session.markers, progress)
    number = np.round(time * VIDEO_RATE_HZ).astype(int)
    known = frame[(frame >= 0) & (frame < 2 * len(frame) + 100)]  # others are damaged
    count = max(int(known.max(initial=-1)) + 1, len(frame))
    there = (number >= 0) & (number < count)
    if there.sum() < 0.5 * count or not there.all() or len(np.unique(number)) < len(number):
        raise CaptureError(
            f"{path}: has {len(time)} frames, {count} were recorded; it is damaged, or does not"
            " belong here"
        )
    first, last = np.zeros((2, count), np.int64)
    first[number], last[number] = found.first, found.last
    rows = np.where((frame >= 0) & (frame < count), frame, 0)
    tags = FrameTags(found.store, first, last).only(rows)
    return tags.without(rows != frame), count - len(time)


def _join(
    session: CaptureSession,
    runs: list[_ProcessedRun],
    skipped: Sequence[dict[str, Any]],
    anchor: str,
) -> ProcessedSession:
    ids = session.markers.ids
    ohm, is_resting = [r.ohm for r in runs], np.concatenate([r.rest for r in runs])
    count, time, begin, dropped = len(is_resting), list[Float](), 0.0, 0
    clocks: dict[str, list[ClockPart]] = {}
    rates: list[float] = []
    spans: list[dict[str, Any]] = []
    for run in runs:
        own = run.processed.tracks.time
        grid = frame_grid(own)
        if grid is not None and grid.is_even:
            dropped += grid.gaps
            rates.append(1 / grid.period)
        time.append(own + begin - own[0])
        later = begin - float(own[0])
        clocks[str(run.told["run"])] = [part.shifted(later) for part in run.clocks]
        ends = float(time[-1][0]), float(time[-1][-1])
        steps = [[at + later, name] for at, name in run.steps]
        spans.append({"begin": ends[0], "end": ends[1], "steps": steps})
        pause = _PAUSE if grid is None else max(round(_PAUSE / grid.period), 1) * grid.period
        begin = float(time[-1][-1]) + pause
    corners = _corners(runs, ids[session.markers.anchor])
    P, S = _places(runs, ids)
    T, R = np.concatenate(time), np.concatenate(ohm)
    grid = frame_grid(T)
    even = grid is not None and grid.is_even
    # Files of tracks count the frames that were dropped, too; signals by frame must go with them.
    number = grid.index if grid is not None and even else np.arange(count)
    tracks = Tracks(T, ids, P, S, number)
    laid = align_with_rest(session.markers, tracks, corners, is_resting, anchor)
    aligned, warnings = laid.aligned, list(laid.warnings)
    names = [str(r.told["run"]) for r in runs]
    R0, told = rest_resistances(names, session.channels, ohm, [r.rest for r in runs])
    warnings += told
    if not even and len(rates) == len(runs) > 1:
        told_rates = ", ".join(f"{r:.4g}" for r in rates)
        warnings.append(
            f"the runs' cameras had different rates ({told_rates} Hz): the files' times are uneven,"
            " and frames that were dropped are not filled in"
        )
    if not is_resting.any():
        warnings.append("no rest was finished: R0 and the rest pose are those of the whole session")
    back = Tracks(T, ids, aligned.points, aligned.sigma, number)
    with np.errstate(all="ignore"):
        quality = {
            "session": str(session.folder), "device": session.device, "version": __version__,
            "unit": session.unit, "layout": session.layout,
            "runs": [
                r.told | span | {"sync": r.sync, "tracks": r.processed.quality}
                for r, span in zip(runs, spans, strict=True)
            ],
            "skipped": list(skipped), "frames": len(T), "seconds": float(T[-1] - T[0]),
            "rate": 1 / grid.period if grid is not None and even else None, "dropped": dropped,
            "aligned_by": laid.by, "aligned_frames": float(aligned.ok.mean()),
            "by_all": laid.by_all, "by_all_off": laid.off,
            "residual": quantiles(aligned.residual),
            "sigma": quantiles(lengths(back.sigma)[back.visible]),
            "seen": dict(
                zip(map(str, ids.tolist()), back.visible.mean(axis=0).tolist(), strict=True)
            ),
            "glued": laid.glued, "warnings": warnings,
            "R0": {
                n: [float(r) if np.isfinite(r) else None for r in of]
                for n, of in zip(names, R0, strict=True)
            },
        }  # fmt: skip
        signals = [relative_change(of, r0) for of, r0 in zip(ohm, R0, strict=True)]
        return ProcessedSession(
            tracks, back, np.concatenate(signals), R, aligned.residual, quality, clocks
        )


def _corners(runs: Sequence[_ProcessedRun], ids: Int) -> NDArray[np.float32]:
    """Of the tags `ids` (a,) in all runs (t, a, 4, 3) mm, one after the other."""
    if len(runs) == 1 and np.array_equal(runs[0].processed.outlined, ids):
        return runs[0].processed.corners
    out = np.full((sum(len(run.ohm) for run in runs), len(ids), 4, 3), np.nan, np.float32)
    end = 0
    for run in runs:
        rows, end = slice(end, end + len(run.ohm)), end + len(run.ohm)
        for k, i in enumerate(run.processed.outlined):
            out[rows, ids.tolist().index(int(i))] = run.processed.corners[:, k]
    return out


def _places(runs: list[_ProcessedRun], ids: Int) -> tuple[Float, Float]:
    """Places and standard deviations (t, m, 3) mm of the tags `ids` (m,) in all runs, one after the
    other, which do not have them any more: each would be in memory twice."""
    count = sum(len(run.ohm) for run in runs)
    if len(runs) == 1 and np.array_equal(runs[0].processed.tracks.ids, ids):
        only = runs[0].processed.tracks
        return only.points, only.sigma
    P, S = np.full((count, len(ids), 3), np.nan), np.full((count, len(ids), 3), np.nan)
    end = 0
    for n, run in enumerate(runs):
        t = run.processed.tracks
        rows, end = slice(end, end + len(t.time)), end + len(t.time)
        column = {int(i): k for k, i in enumerate(t.ids)}
        for k, i in enumerate(ids):
            if int(i) in column:
                P[rows, k], S[rows, k] = t.points[:, column[int(i)]], t.sigma[:, column[int(i)]]
        none = np.zeros((0, len(t.ids), 3))
        gone = Tracks(np.zeros(0), t.ids, none, none, np.zeros(0, np.int64))
        runs[n] = replace(run, processed=replace(run.processed, tracks=gone))
    return P, S
