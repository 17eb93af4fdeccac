"""Process one run of a recorded session: tracks, and the signals at their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.cameras.image_sources import Video, measure_timing
from ...capture.cameras.rig_file import Rig
from ...capture.clocks.clock_fit import fit_clocks
from ...capture.clocks.synchronization import synchronize_by_motion
from ...capture.files.absent_markers import list_some
from ...capture.files.formats import read_track_file
from ...capture.files.length_units import LengthUnit
from ...capture.readout.recording import Recording, read_recording
from ...capture.sessions.camera_recorder import VIDEO_RATE_HZ
from ...capture.sessions.recorded_tags import CameraRecording, read_camera_tags
from ...capture.sessions.results import ClockPart
from ...capture.sessions.session import (
    BOARD,
    CAMERAS,
    CaptureSession,
    read_log,
    rest_frames,
    run_ending,
    step_starts,
)
from ...capture.sessions.signals import (
    marker_distances,
    resistances,
    resistances_at,
    restarts,
    sync_record,
    synchronize_signals,
)
from ...capture.tracking.observations import FrameTags
from ...capture.videos.camera_sync import TrackWarning
from ...capture.videos.video_detection import VideoDetections, detect_markers
from ...capture.videos.video_tracks import VideoTracks, assemble
from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.progress import Progress

MAX_TIME_WITHOUT_TAGS_S = 5.0  # at the end of a camera's recording, without a warning
MIN_VIDEO_SHARE = 0.5  # of the recorded frames, that a video has
MIN_COMMON_MARKERS = 3  # of the device, in a file of tracks


@dataclass(frozen=True)
class ProcessedRun:
    """A processed run.

    Attributes:
        video: Its tracks.
        ohm: Resistances at the tracks' times (t, c), ohm.
        is_resting: Frames of finished rests (t,).
        sync: Values of `quality.json` on the comparison of the clocks.
        record: Values of `quality.json` on the run.
        clocks: Relations of the board's clock to the tracks' times.
        steps: Start, s of the tracks' time, and name of each step.
    """

    video: VideoTracks
    ohm: Float
    is_resting: Bool
    sync: dict[str, Any]
    record: dict[str, Any]
    clocks: list[ClockPart]
    steps: list[tuple[float, str]]


@dataclass(frozen=True)
class _Cameras:
    """The cameras that recorded something in a run.

    Attributes:
        rig: These cameras.
        recordings: What they recorded.
        warnings: Warnings about the other cameras.
    """

    rig: Rig
    recordings: list[CameraRecording]
    warnings: list[str]

    @property
    def start_ns(self) -> int:
        """Time of the first frame, ns: the tracks' time zero."""
        return min(int(r.time[0]) for r in self.recordings)


def process_run(
    session: CaptureSession, run: Path, *, from_video: bool, progress: Progress
) -> ProcessedRun:
    """Process a run that was recorded with cameras.

    Args:
        session: The session.
        run: Folder of the run.
        from_video: Whether tags are detected again in the videos.
        progress: Called with the progress.

    Raises:
        CaptureError: No camera recorded tags that can be located.
    """
    events = read_log(run)
    # Read before the tags: parsing the text takes more memory than the samples do.
    recording = read_recording(run / BOARD) if (run / BOARD).exists() else None
    cameras = _read_cameras(session, run)
    names = [f"{run.name}/{c.name}" for c in cameras.rig.cameras]
    detections, missing = _detections(session, run, cameras, from_video, progress)
    markers = session.markers
    try:
        video = assemble(
            detections,
            cameras.rig,
            markers.size,
            names,
            progress=progress,
            frame=session.rig.cameras[0],
            outlined=markers.ids[markers.anchor],
        )
    except CaptureError as error:
        error.problem = "; ".join([error.problem, *cameras.warnings])
        raise
    warnings = video.quality["warnings"]
    warnings += cameras.warnings
    warnings += [
        TrackWarning(f"{name}.mkv lacks {n} of the recorded frames.", "frames-missing-in-video")
        for name, n in missing.items()
    ]
    tracks, start = video.tracks, cameras.start_ns
    ohm = np.full((len(tracks.time), len(session.channels)), np.nan)
    sync: dict[str, Any] = {"method": "none"}
    clocks: list[ClockPart] = []
    if recording is not None:
        offsets = video.quality["offsets"]
        ohm, sync, clocks = synchronize_signals(
            session, recording, cameras.recordings, start, offsets, tracks
        )
    warnings += _damage_warnings(run, names, cameras.recordings, recording)
    warnings += _end_warnings(names, detections)
    cut = sum(r.cut for r in cameras.recordings)
    return ProcessedRun(
        video,
        ohm,
        rest_frames(events, tracks.time, start),
        sync,
        {"run": run.name, "ended": run_ending(run), "cut": cut},
        clocks,
        step_starts(events, start),
    )


def _read_cameras(session: CaptureSession, run: Path) -> _Cameras:
    if not session.rig.cameras:
        raise CaptureError(
            "the calibration of the cameras is missing",
            code="calibration-missing",
            where=session.folder / CAMERAS,
            action="Copy it there, or give the tracks of a motion-capture system",
        )
    cameras, recordings = [], []
    warnings: list[str] = []
    for camera in session.rig.cameras:
        try:
            recording = read_camera_tags(run, camera.name, session.markers.ids)
        except CaptureError as error:
            problem = str(error)
        else:
            if len(recording.time):
                cameras.append(camera)
                recordings.append(recording)
                continue
            problem = f"no picture was recorded by {camera.name}"
        warnings.append(
            TrackWarning(
                f"{run.name} is processed without {camera.name}: {problem}", "camera-left-out"
            )
        )
    if not cameras:
        raise CaptureError(
            f"no camera's recording can be used: {'; '.join(warnings)}",
            code="recordings-unusable",
            where=run,
        )
    return _Cameras(replace(session.rig, cameras=tuple(cameras)), recordings, warnings)


def _detections(
    session: CaptureSession, run: Path, cameras: _Cameras, from_video: bool, progress: Progress
) -> tuple[list[VideoDetections], dict[str, int]]:
    """Return the tags of each camera, and how many frames are missing in which video."""
    detections, missing = [], {}
    for camera, recording in zip(cameras.rig.cameras, cameras.recordings, strict=True):
        time, tags = (recording.time - cameras.start_ns) / 1e9, recording.tags
        if from_video:
            tags, count = _detect_again(session, run, camera, recording.frame, progress)
            if count:
                missing[f"{run.name}/{camera.name}"] = count
        detections.append(VideoDetections(time, tags, measure_timing(time), 0))
    return detections, missing


def _detect_again(
    session: CaptureSession, run: Path, camera: Camera, frame: Int, progress: Progress
) -> tuple[FrameTags, int]:
    """Detect the device's tags in a run's video.

    A video that was cut off, or that has gaps from a full disk, states by its times which frames it
    has.

    Args:
        session: The session.
        run: Folder of the run.
        camera: The camera.
        frame: Numbers of the recorded frames (f,).
        progress: Called with the progress.

    Returns:
        The tags in the recorded frames, and the number of frames that the video lacks.
    """
    path = run / f"{camera.name}.mkv"
    if not path.exists():
        raise CaptureError(
            "there is no video of the session",
            code="video-missing",
            where=path,
            action="Process the session without videos",
        )
    time, detected = detect_markers(Video(path), camera, session.markers, progress)
    number = np.round(time * VIDEO_RATE_HZ).astype(int)
    plausible = frame[(frame >= 0) & (frame < 2 * len(frame) + 100)]  # others are damaged
    count = max(int(plausible.max(initial=-1)) + 1, len(frame))
    is_recorded = (number >= 0) & (number < count)
    if (
        is_recorded.sum() < MIN_VIDEO_SHARE * count
        or not is_recorded.all()
        or len(np.unique(number)) < len(number)
    ):
        raise CaptureError(
            f"has {len(time)} frames, but {count} were recorded",
            code="video-of-another-run",
            where=path,
            action="Check that it is not damaged and belongs to this run",
            frames=len(time),
            recorded=count,
        )
    first, last = np.zeros((2, count), np.int64)
    first[number], last[number] = detected.first, detected.last
    rows = np.where((frame >= 0) & (frame < count), frame, 0)
    tags = FrameTags(detected.store, first, last).only(rows)
    return tags.without(rows != frame), count - len(time)


def _damage_warnings(
    run: Path,
    names: Sequence[str],
    recordings: Sequence[CameraRecording],
    board: Recording | None,
) -> list[TrackWarning]:
    """Return a warning if lines of files are damaged."""
    damaged = []
    if board is not None and board.damaged_lines:
        damaged.append(f"lines of {run.name}/{BOARD}: {board.damaged_lines}")
    damaged += [
        f"lines of {name}'s files: {r.cut}"
        for name, r in zip(names, recordings, strict=True)
        if r.cut
    ]
    if not damaged:
        return []
    return [TrackWarning(f"cut or damaged, and left out: {', '.join(damaged)}", "lines-damaged")]


def _end_warnings(
    names: Sequence[str], detections: Sequence[VideoDetections]
) -> list[TrackWarning]:
    """Return warnings about cameras that see no tag for long at the end."""
    warnings = []
    for name, video in zip(names, detections, strict=True):
        visible = np.flatnonzero(video.tags.count)
        rest = video.time[-1] - video.time[visible[-1]] if len(visible) else 0.0
        if rest > MAX_TIME_WITHOUT_TAGS_S:
            warnings.append(
                TrackWarning(
                    f"{name}: shows no tag in its last {rest:.0f} s. Check that it was not covered"
                    " and that its file is not damaged.",
                    "no-tags-at-the-end",
                )
            )
    return warnings


def process_captured_run(
    session: CaptureSession, run: Path, path: Path, unit: LengthUnit | None = None
) -> ProcessedRun:
    """Process a run whose markers another system recorded; the clocks are compared by motion.

    Args:
        session: The session.
        run: Folder of the run.
        path: File of the tracks.
        unit: Unit of its positions, if it does not state it.

    Raises:
        CaptureError: The tracks cannot be read or are not of the device
            (`markers-of-another-device`), or the clocks cannot be compared.
    """
    tracks, notes = _read_device_tracks(session, path, unit)
    recording = read_recording(run / BOARD)
    board_time = recording.device_us / 1e6
    board_ohm = resistances(session, recording)
    sync = synchronize_by_motion(tracks.time, marker_distances(tracks), board_time, board_ohm)
    about_sync = sync_record(sync, [])
    if restarts(recording):
        about_sync["error_ms"] = None
        about_sync["notes"] = [
            "The read-out board restarted in this run. Signals after that may be off by tens of ms;"
            " record it again."
        ]
    quality: dict[str, Any] = {
        "warnings": notes,
        "by_several": float(tracks.visible.mean()),
        "by_one": 0.0,
        "impossible": 0,
    }
    no_corners = np.empty((len(tracks.time), 0, 4, 3), np.float32)
    video = VideoTracks(
        tracks, 2 * tracks.visible.astype(np.int8), quality, np.zeros(0, np.int64), no_corners
    )
    arrival = fit_clocks(board_time, recording.host_ns / 1e9)
    events = read_log(run)
    starts = step_starts(events)
    by_board = (np.array([time for time, _ in starts]) - arrival.offset) / (1 + arrival.drift)
    steps = [
        (float(time), name)
        for time, (_, name) in zip(sync.to_camera(by_board), starts, strict=True)
    ]
    record = {
        "run": run.name,
        "ended": run_ending(run),
        "cut": recording.damaged_lines,
        "tracks_of": str(path),
    }
    return ProcessedRun(
        video,
        resistances_at(sync.to_device(tracks.time), board_time, board_ohm),
        rest_frames(events, arrival.to_host(sync.to_device(tracks.time))),
        about_sync,
        record,
        [ClockPart(slice(0, len(board_time)), sync.offset, sync.drift)],
        steps,
    )


def _read_device_tracks(
    session: CaptureSession, path: Path, unit: LengthUnit | None
) -> tuple[Tracks, list[str]]:
    """Read the tracks of the device's markers, and notes on the file; others are left out."""
    file = read_track_file(path, unit)
    tracks = file.tracks
    is_marker = np.isin(tracks.ids, session.markers.ids)
    if file.is_in_file_order or is_marker.sum() < MIN_COMMON_MARKERS:
        names = list_some(file.labels or tuple(map(str, tracks.ids.tolist())))
        required = ", ".join(map(str, session.markers.ids.tolist()))
        raise CaptureError(
            f"has the markers {names}; the device has {required}",
            code="markers-of-another-device",
            where=path,
            action="Name the markers by the device's numbers (tag_1, tag_2, ...)",
        )
    others = [f"tag_{number}" for number in tracks.ids[~is_marker].tolist()]
    notes = [f"{len(others)} other markers are left out: {list_some(others)}"] if others else []
    selected = Tracks(
        tracks.time,
        tracks.ids[is_marker],
        tracks.points[:, is_marker],
        tracks.sigma[:, is_marker],
        tracks.frame,
    )
    return selected, [f"{path}: {note}" for note in (*file.notes, *notes)]
