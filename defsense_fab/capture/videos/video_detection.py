"""Looking through videos: the tags in every frame, and when it was taken."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ...core.markers import Markers
from ...core.progress import Progress, silent
from ..cameras.image_sources import Timing, Video, measure_timing, run_in_threads
from ..tags.detection import TagFollower, TagView, image_size_error, opencv_detector, to_grey
from ..tags.tag_patterns import FAMILIES, Dictionary, dictionary
from ..tracking.observations import FrameTags, store_views
from .detector_compilation import tell_of_compilation

_LOOKED, _SOME = 4, 3  # frames of a video in which other families are tried; tags that tell
_ROUNDED = 8e-4  # s, that stamps in whole ms may be off


@dataclass(frozen=True)
class VideoDetections:
    """A video that was looked through: the times (t,) s of its frames, and the tags in each."""

    time: Float
    tags: FrameTags
    timing: Timing
    expected: int


def detect_video(
    paths: Sequence[Path],
    cameras: Sequence[Camera],
    tags: Dictionary,
    rate: float | None,
    progress: Progress = silent,
) -> list[VideoDetections]:
    """Look through all videos, each in a thread of its own. Raises CaptureError for one that cannot
    be read or in which there is no tag."""
    videos = [Video(p, rate) for p in paths]
    for video, camera in zip(videos, cameras, strict=True):
        if video.size != camera.size:
            raise image_size_error(camera, video.size, video.path)
    tell_of_compilation(lambda note: progress("tags", 0.0, note))
    done = [0] * len(videos)
    total = max(sum(v.expected for v in videos), 1)

    def look(k: int, stop: threading.Event) -> VideoDetections:
        found = TagFollower(cameras[k], tags)
        times: list[float] = []

        def views() -> Iterator[TagView]:
            for _, time, image in videos[k].frames():
                if stop.is_set():
                    break
                times.append(time)
                yield found.find(image)
                done[k] += 1
                if k == 0:
                    progress("tags", min(sum(done) / total, 1.0), f"{done[0]} frames")

        shown = store_views(views())
        videos[k].close()
        stamps = _even(np.array(times))
        return VideoDetections(stamps, shown, measure_timing(stamps), videos[k].expected)

    watched = run_in_threads(look, range(len(videos)), len(videos))
    progress("tags", 1.0, "done")
    for path, w in zip(paths, watched, strict=True):
        if not len(w.time):
            raise CaptureError(f"{path}: no frame of it can be read; is it damaged?")
        if w.timing.back:
            raise CaptureError(
                f"{path}: its time stamps go back {w.timing.back} times; record it again, or give"
                " --rate if its frames are evenly spaced"
            )
    if not any(w.tags.count.any() for w in watched):
        raise CaptureError(_nothing(paths, tags, rate))
    return watched


def _even(time: Float) -> Float:
    """Stamps (t,) s; evenly spaced where they are that to the whole ms that Matroska keeps: half a
    ms is 0.05 mm at 100 mm/s."""
    if len(time) < 3:
        return time
    number = np.arange(len(time))
    fit = np.polyval(np.polyfit(number, time, 1), number)
    whole = np.abs(1e3 * time - np.round(1e3 * time)).max() < 1e-6
    return (
        np.asarray(fit - fit[0] + time[0])
        if whole and np.abs(fit - time).max() < _ROUNDED
        else time
    )


def detect_all(
    video: Video, camera: Camera, markers: Markers, progress: Progress = silent
) -> tuple[Float, FrameTags]:
    """The times (t,) s of every frame of one video, as its file has them, and the device's tags in
    each."""
    if video.size != camera.size:
        raise image_size_error(camera, video.size, video.path)
    tell_of_compilation(lambda note: progress("tags", 0.0, note))
    found = TagFollower(camera, dictionary(markers.dictionary))
    times: list[float] = []

    def views() -> Iterator[TagView]:
        for k, time, image in video.frames():
            times.append(time)
            view = found.find(image)
            yield view.only(np.isin(view.ids, markers.ids))
            progress("tags", min(k / max(video.expected, 1), 1.0), f"{k + 1} frames")

    shown = store_views(views())
    video.close()
    return np.array(times), shown


def _nothing(paths: Sequence[Path], tags: Dictionary, rate: float | None) -> str:
    """What to say where no tag was found: perhaps there are others."""
    found: dict[str, list[int]] = {}
    # The small families of a kind are the first tags of the largest one.
    small = tuple(f"_{n}" for n in (50, 100, 250))
    kinds = [name for name in FAMILIES if not name.endswith(small)]
    detectors = {name: opencv_detector(dictionary(name)) for name in kinds}
    for path in paths:
        video = Video(path, rate)
        every = max(video.expected // _LOOKED, 1)
        for k, _, image in video.frames():
            if k >= _LOOKED * every:
                break
            if k % every:
                continue
            for name, one in detectors.items():
                _, numbers, _ = one.detectMarkers(to_grey(image))
                if numbers is not None:
                    found.setdefault(name, []).extend(np.asarray(numbers).ravel().tolist())
        video.close()
    best = max(found, key=lambda name: len(found[name]), default="")
    where = ", ".join(str(p) for p in paths)
    if len(found.get(best, ())) >= _SOME:
        if best.endswith("_1000"):
            most = max(found[best])
            best = best[:4] + str(next(n for n in (50, 100, 250, 1000) if most < n))
        if best != tags.name:
            return f"{where}: no tag of {tags.name}, but tags of {best}: give --dictionary {best}"
    return (
        f"{where}: no tag of {tags.name} found in any frame; look at light, focus and the white"
        " margin around the tags"
    )
