"""Detect the tags in every frame of videos."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ...core.machine.compiled import is_compiled
from ...core.markers import Markers
from ...core.progress import Progress
from ..cameras.image_sources import Timing, Video, measure_timing, run_in_threads
from ..tags import edge_fit
from ..tags.detection import (
    Detector,
    TagFollower,
    TagView,
    image_size_error,
)
from ..tags.tag_patterns import Dictionary, dictionary
from ..tracking.observations import FrameTags, store_views

COMPILING = "compiling the tag detector, once on this computer: about 20 s"


def compile_detector(camera: Camera, tags: Dictionary, report: Callable[[str], None]) -> None:
    """Compile the tag detector now, if that was not done on this computer, and report it.

    Call it before work that must not wait for the compilation.
    """
    if report_compilation(report):
        Detector(camera, tags)


def report_compilation(report: Callable[[str], None]) -> bool:
    """Report if the next detector will have to be compiled first; return whether it will."""
    is_due = not is_compiled(edge_fit)
    if is_due:
        report(COMPILING)
    return is_due


MAX_ROUNDING_S = 8e-4  # of stamps in whole ms


@dataclass(frozen=True)
class VideoDetections:
    """Tags in a video.

    Attributes:
        time: Times of its frames (t,), s.
        tags: Tags in each frame.
        timing: Regularity of its time stamps.
        expected: Number of frames that the file states; 0 if it states none.
    """

    time: Float
    tags: FrameTags
    timing: Timing
    expected: int


def detect_videos(
    paths: Sequence[Path],
    cameras: Sequence[Camera],
    tags: Dictionary,
    rate: float | None,
    progress: Progress,
) -> list[VideoDetections]:
    """Detect the tags in videos, each in its own thread.

    Args:
        paths: The videos.
        cameras: The camera of each video.
        tags: Family of the tags.
        rate: Frames per second of image sequences; None for videos.
        progress: Receives progress.

    Raises:
        CaptureError: If a video cannot be read, or there is no tag in any.
    """
    videos = [Video(p, rate) for p in paths]
    for video, camera in zip(videos, cameras, strict=True):
        if video.size != camera.size:
            raise image_size_error(camera, video.size, video.path)
    report_compilation(lambda note: progress("tags", 0.0, note))
    done = [0] * len(videos)
    total = max(sum(v.expected for v in videos), 1)

    def detect(k: int, stop: threading.Event) -> VideoDetections:
        follower = TagFollower(cameras[k], tags)
        times: list[float] = []

        def views() -> Iterator[TagView]:
            for _, time, image in videos[k].frames():
                if stop.is_set():
                    break
                times.append(time)
                yield follower.find(image)
                done[k] += 1
                if k == 0:
                    progress("tags", min(sum(done) / total, 1.0), f"{done[0]} frames")

        frame_tags = store_views(views())
        videos[k].close()
        stamps = _undo_rounding(np.array(times))
        return VideoDetections(stamps, frame_tags, measure_timing(stamps), videos[k].expected)

    detections = run_in_threads(detect, range(len(videos)), len(videos))
    progress("tags", 1.0, "done")
    for path, detection in zip(paths, detections, strict=True):
        if not len(detection.time):
            raise CaptureError(
                "no frame can be read",
                code="video-unreadable",
                where=path,
                action="Check that the video is not damaged",
            )
        if detection.timing.back:
            raise CaptureError(
                f"its time stamps go back {detection.timing.back} times",
                code="times-not-increasing",
                where=path,
                action="Record it again, or give its rate if frames are evenly spaced",
                count=detection.timing.back,
            )
    if not any(detection.tags.count.any() for detection in detections):
        raise CaptureError(
            f"no tag of {tags.name} was found in any frame",
            code="no-tag-in-video",
            where=", ".join(map(str, paths)),
            action="Check the dictionary, light, focus and the white margin around the tags",
        )
    return detections


def _undo_rounding(time: Float) -> Float:
    """Return stamps (t,), s, evenly spaced if they are so up to rounding.

    Matroska stores whole ms; half a ms is 0.05 mm at 100 mm/s.
    """
    if len(time) < 3:
        return time
    number = np.arange(len(time))
    line = np.polyval(np.polyfit(number, time, 1), number)
    is_rounded = np.abs(1e3 * time - np.round(1e3 * time)).max() < 1e-6
    return (
        np.asarray(line - line[0] + time[0])
        if is_rounded and np.abs(line - time).max() < MAX_ROUNDING_S
        else time
    )


def detect_markers(
    video: Video, camera: Camera, markers: Markers, progress: Progress
) -> tuple[Float, FrameTags]:
    """Detect a device's tags in every frame of one video.

    Returns:
        The frames' times (t,), s, as the file states them, and the tags in each frame.

    Raises:
        CaptureError: If the images have another size than the camera.
    """
    if video.size != camera.size:
        raise image_size_error(camera, video.size, video.path)
    report_compilation(lambda note: progress("tags", 0.0, note))
    follower = TagFollower(camera, dictionary(markers.dictionary))
    times: list[float] = []

    def views() -> Iterator[TagView]:
        for k, time, image in video.frames():
            times.append(time)
            view = follower.find(image)
            yield view.only(np.isin(view.ids, markers.ids))
            progress("tags", min(k / max(video.expected, 1), 1.0), f"{k + 1} frames")

    frame_tags = store_views(views())
    video.close()
    return np.array(times), frame_tags
