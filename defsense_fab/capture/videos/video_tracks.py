"""Make tracks of markers from videos of several cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.progress import Progress, silent
from ..cameras.rig_file import Rig, read_rig
from ..clocks.clock_fit import even_frame_times
from ..tags.tag_patterns import dictionary
from ..tracking.observations import StoredObservations, observe
from ..tracking.track_filters import find_reachable
from .camera_agreement import agreement_warnings, check_agreement
from .camera_sync import Count
from .located_tags import LocatedTags, locate_scene
from .track_quality import REPEATED_TAGS_ACTION, WatchedVideo, measure_quality
from .video_detection import VideoDetections, detect_videos

#: Root mean square, and relative to the median: with a larger residual, views of a tag are not of
#: one instant, or not of one tag.
MIN_OUTLIER_PX, OUTLIER_FACTOR = 0.3, 8.0
MAX_DISAGREEMENT = 0.5  # share of the tags that several cameras see in a frame
MIN_POSITIONS = 20  # from which outliers are determined
MAX_OFFSET_S = 1e6


@dataclass(frozen=True)
class VideoTracks:
    """Tracks of m markers in the frame of a camera.

    Attributes:
        tracks: The tracks.
        cameras: Number of cameras of each position (t, m).
        quality: Values of `quality.json`; its `warnings` are `TrackWarning`s.
        outlined: Tags whose corners are kept (k,).
        corners: Their corners, where several cameras saw them (t, k, 4, 3), mm, in single
            precision.
    """

    tracks: Tracks
    cameras: Count
    quality: dict[str, Any]
    outlined: Int
    corners: NDArray[np.float32]


def process_videos(
    paths: Sequence[Path],
    calibration: Path,
    size: float,
    family: str,
    *,
    rate: float | None = None,
    offsets: Sequence[float] | None = None,
    world: bool = False,
    progress: Progress = silent,
) -> VideoTracks:
    """Make tracks from video files.

    Args:
        paths: Videos in the order of the calibration's cameras.
        calibration: File of the cameras.
        size: Side of the tags, mm.
        family: Family of the tags.
        rate: Frames per second of image sequences, Hz.
        offsets: Times to be added to those of each video, s; found by default.
        world: Whether tracks are in the world of the calibration instead of the first camera's
            frame; `quality` states the frame.
        progress: Receives progress.

    Raises:
        CaptureError: If files do not belong together, or no tag can be located.
    """
    if not 0.1 <= size <= 1000:
        raise CaptureError(
            f"a tag size of {size:g} mm is not possible",
            code="out-of-range",
            where="size",
            action="Give the side of the black square, 0.1 to 1000 mm",
        )
    rig = read_rig(calibration)
    tags = dictionary(family)
    if len(paths) != len(rig.cameras):
        names = ", ".join(c.name for c in rig.cameras)
        raise CaptureError(
            f"has {len(rig.cameras)} cameras ({names}), but there are {len(paths)} videos",
            code="camera-count-differs",
            where=calibration,
            action="Give one video for each camera, in this order",
            cameras=len(rig.cameras),
            count=len(paths),
        )
    if not rig.placed:
        raise CaptureError(
            "does not state the poses of the cameras",
            code="camera-poses-missing",
            where=calibration,
            action="Run 'defsense capture camera arrange'",
        )
    if len({p.resolve() for p in paths}) < len(paths):
        raise CaptureError(
            "the same video is given twice",
            code="video-repeated",
            where="videos",
            action="Give one video for each camera",
        )
    check_offsets(offsets, len(paths))
    detections = detect_videos(paths, rig.cameras, tags, rate, progress)
    first = rig.cameras[0]
    world_camera = replace(first, rotation=np.eye(3), translation=np.zeros(3))  # the world's axes
    tracks = assemble(
        detections,
        rig,
        size,
        [str(p) for p in paths],
        offsets,
        progress,
        world_camera if world else first,
    )
    frame = f"the world of {calibration}" if world else f"of camera {first.name}"
    return replace(tracks, quality={**tracks.quality, "frame": frame})


def assemble(
    detections: Sequence[VideoDetections],
    rig: Rig,
    size: float,
    names: Sequence[str],
    offsets: Sequence[float] | None = None,
    progress: Progress = silent,
    frame: Camera | None = None,
    outlined: Int | None = None,
) -> VideoTracks:
    """Make tracks from detections, at the times of the first camera's frames.

    Args:
        detections: Detections in each video.
        rig: The cameras.
        size: Side of the tags, mm.
        names: Names of the videos.
        offsets: Times to be added to those of each video, s; found by default.
        progress: Receives progress.
        frame: Camera in whose frame the tracks are; the first one by default.
        outlined: Tags whose corners are kept (k,).

    Raises:
        CaptureError: If the cameras do not agree, or no tag can be located.
    """
    given_offsets = check_offsets(offsets, len(detections))
    surveys = [video.tags.survey() for video in detections]
    ids = np.unique(np.concatenate([n for n, _ in surveys]))
    observations = [
        _observe_frames(video, offset, ids)
        for video, offset in zip(detections, given_offsets, strict=True)
    ]
    time = observations[0].time
    outlined = np.intersect1d(ids, outlined if outlined is not None else [])
    column = np.searchsorted(ids, outlined)
    scene = locate_scene(
        rig, observations, size, frame or rig.cameras[0], column, offsets is not None, progress
    )
    located = scene.located
    videos = [
        WatchedVideo(name, video, repeated_ids)
        for name, video, (_, repeated_ids) in zip(names, detections, surveys, strict=True)
    ]
    try:
        check_agreement(located, rig, scene.by_camera, size, names)
    except CaptureError as error:
        raise _add_repeated_tags(error, videos) from error
    progress("tracks", 0.7, "removing impossible positions")
    is_outlier, disagreeing = _find_disagreements(located)
    is_kept, impossible = _remove_impossible(located, is_outlier, scene.is_moving(time), time)
    has_position = is_kept.any(axis=0)
    if not has_position.any():
        raise _add_repeated_tags(_invisible_error(names), videos)
    cameras = np.where(is_kept, located.cameras, np.int8(0))
    located.corners[cameras[:, column] < 2] = np.nan
    cameras = cameras[:, has_position]
    tracks = Tracks(
        time,
        ids[has_position],
        located.points[:, has_position],
        located.sigma[:, has_position],
        np.flatnonzero(_is_new_frame(detections[0])),
    )
    progress("tracks", 1.0, "done")
    quality = measure_quality(videos, located, is_kept, tracks, cameras, size)
    quality["warnings"] += scene.warnings(names, offsets is not None)
    quality["warnings"] += agreement_warnings(
        located, is_outlier, disagreeing, time, quality["residual"]
    )
    quality |= {
        "impossible": impossible,
        "offsets": [a + b for a, b in zip(given_offsets, scene.shift, strict=True)],
        "disagreeing": int(is_outlier.sum()),
        "moved": [move.record for move in scene.moves],
    }
    return VideoTracks(tracks, cameras, quality, outlined, located.corners)


def _find_disagreements(located: LocatedTags) -> tuple[Bool, Bool]:
    """Return the positions (t, m) that are outliers, and the frames (t,) in which many are."""
    is_outlier = _find_outliers(located)
    disagreeing = _disagreeing_frames(located, is_outlier)
    return is_outlier | (disagreeing[:, None] & (located.cameras >= 2)), disagreeing


def _invisible_error(names: Sequence[str]) -> CaptureError:
    return CaptureError(
        "no tag could be located in any frame",
        code="no-tag-located",
        where=", ".join(names),
        action="Check that the tags are visible and that the calibration is right",
    )


def _add_repeated_tags(error: CaptureError, videos: Sequence[WatchedVideo]) -> CaptureError:
    """Return an error that also names tags shown twice at once, which are a likely cause."""
    notes = [f"{video.name} {video.repeated_tags}" for video in videos if video.repeated_tags]
    if not notes:
        return error
    return CaptureError(
        f"{error.problem}; {'; '.join(notes)}",
        code=error.code,
        where=error.where,
        action=REPEATED_TAGS_ACTION,
        **error.data,
        repeated={video.name: video.repeated_ids.tolist() for video in videos},
    )


def _is_new_frame(video: VideoDetections) -> Bool:
    """Return which frames (t,) are not repetitions of the one before."""
    return np.append(True, np.diff(video.time) > 0)


def _observe_frames(video: VideoDetections, offset: float, ids: Int) -> StoredObservations:
    """Return what a camera saw of the tags `ids`, each frame once, at times plus `offset` s."""
    is_new = _is_new_frame(video)
    # Stamps are late by different times of some ms, which looks like motion.
    time = even_frame_times(video.time[is_new]).time
    return observe(time + offset, video.tags.only(is_new), ids)


def _remove_impossible(
    located: LocatedTags, is_outlier: Bool, is_moving: Bool, time: Float
) -> tuple[Bool, int]:
    """Set positions to NaN that are outliers, of moved cameras, or out of reach.

    Args:
        located: Located tags, changed in place.
        is_outlier: Positions (t, m) on which cameras disagree.
        is_moving: Frames (t,) in which a camera moves.
        time: Times of the frames (t,), s.

    Returns:
        The positions that are kept (t, m), and the number of positions out of reach.
    """
    points, sigma = located.points, located.sigma
    points[is_outlier] = np.nan
    points[is_moving] = np.nan
    is_kept = find_reachable(time, points, sigma)
    impossible = int((np.isfinite(points[..., 0]) & ~is_kept).sum())
    points[~is_kept], sigma[~is_kept] = np.nan, np.nan
    return is_kept, impossible


def check_offsets(offsets: Sequence[float] | None, count: int) -> list[float]:
    """Return offsets relative to the first one (count,), s; zero if none are given.

    Raises:
        CaptureError: If they are invalid.
    """
    if offsets is None:
        return [0.0] * count
    if len(offsets) != count:
        raise CaptureError(
            f"{len(offsets)} offsets are given for {count} cameras",
            code="offset-count-differs",
            where="offsets",
            action="Give one offset for each camera",
            count=len(offsets),
        )
    if not all(abs(s) < MAX_OFFSET_S for s in offsets):
        raise CaptureError(
            f"{', '.join(f'{s:g}' for s in offsets)} are not valid offsets",
            code="offset-invalid",
            where="offsets",
            action="Give the seconds to be added to each video's times",
        )
    return [s - offsets[0] for s in offsets]


def _find_outliers(located: LocatedTags) -> Bool:
    """Return positions (t, m) whose views differ much more than those of the others."""
    by_several = (located.cameras >= 2) & np.isfinite(located.miss)
    if by_several.sum() < MIN_POSITIONS:
        return np.zeros(by_several.shape, bool)
    limit = max(MIN_OUTLIER_PX, OUTLIER_FACTOR * float(np.median(located.miss[by_several])))
    # A tag with less exact corners may have a larger residual.
    sigma = np.linalg.norm(located.sigma, axis=2)
    relative_sigma = np.maximum(sigma / max(float(np.median(sigma[by_several])), 1e-12), 1.0)
    return np.asarray(
        by_several
        & (located.miss > limit * np.where(np.isfinite(relative_sigma), relative_sigma, 1.0))
    )


def _disagreeing_frames(located: LocatedTags, is_outlier: Bool) -> Bool:
    """Return frames (t,) in which the cameras' views of most tags disagree.

    The views that seem to agree in these frames do so by chance.
    """
    by_several = located.views >= 2
    is_wrong = by_several & (is_outlier | (located.cameras < 2))
    return np.asarray(
        is_wrong.sum(axis=1) > MAX_DISAGREEMENT * np.maximum(by_several.sum(axis=1), 1)
    )
