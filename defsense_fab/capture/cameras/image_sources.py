"""Recorded images: video files, folders of images, numbered images."""

from __future__ import annotations

import os
import re
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

import cv2
import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ..tags.detection import Image

# A camera that is plugged in, read by a thread of its own.

_KEPT = 4  # frames, if nobody takes them
_HANGS = 3.0  # s after which a thread that does not come back is left to itself
_GONE = 2.0  # s without a frame after which a camera has vanished
#: Of each system; on Windows the first choice of OpenCV takes many seconds to open a camera.
_BACK_ENDS = {"win32": cv2.CAP_DSHOW, "darwin": cv2.CAP_AVFOUNDATION}


class Images(Protocol):
    """Frames as they come: `start` before the rest, `close` after it."""

    name: str
    size: tuple[int, int]

    def start(self) -> None:
        """Begin; raises CaptureError where there is no camera."""

    def read(self, timeout: float) -> tuple[Image, int] | None:
        """The next frame, (h, w) or (h, w, 3), and the monotonic clock, ns, at which it was taken;
        None where none came in time. Raises CaptureError when the camera is gone."""

    def close(self) -> None: ...


class Webcam:
    """`Images` of a camera by its index (0) or device (/dev/video0). Frames that nobody takes are
    dropped, oldest first."""

    def __init__(
        self, address: str, size: tuple[int, int] | None = None, rate: float | None = None
    ) -> None:
        self.name, self.size = address, size or (1280, 720)
        self._rate = rate
        self._capture: cv2.VideoCapture | None = None
        self._frames: deque[tuple[Image, int]] = deque(maxlen=_KEPT)
        self._arrived, self._over = threading.Condition(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._heard = 0

    def start(self) -> None:
        quiet()
        index = int(self.name) if self.name.isdigit() else self.name
        self._capture = cv2.VideoCapture(index, _BACK_ENDS.get(sys.platform, cv2.CAP_ANY))
        if not self._capture.isOpened():
            self._capture.release()
            raise CaptureError(
                f"camera {self.name}: cannot be opened; is it plugged in, and does no other program"
                " (a browser, a meeting) use it? defsense doctor tells more",
                code="camera-unavailable",
                camera=self.name,
            )
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self.size[0])
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self.size[1])
        if self._rate:
            self._capture.set(cv2.CAP_PROP_FPS, self._rate)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        there, image = self._capture.read()
        if not there:
            self._capture.release()
            raise CaptureError(
                f"camera {self.name}: gives no picture",
                code="camera-gives-no-image",
                camera=self.name,
            )
        self.size = (image.shape[1], image.shape[0])
        self._heard = time.monotonic_ns()
        self._thread.start()

    def read(self, timeout: float) -> tuple[Image, int] | None:
        with self._arrived:
            self._arrived.wait_for(lambda: bool(self._frames), timeout)
            if self._frames:
                return self._frames.popleft()
        if time.monotonic_ns() - self._heard > _GONE * 1e9:
            raise CaptureError(
                f"camera {self.name}: gives no more pictures; was it unplugged?",
                code="camera-disconnected",
                camera=self.name,
            )
        return None

    def close(self) -> None:
        """End the thread, which lets go of the camera. One that hangs in its driver is left to
        itself: it does so when it comes back."""
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join(_HANGS)
        elif self._capture is not None:
            self._capture.release()

    def _run(self) -> None:
        assert self._capture is not None
        try:
            self._grab(self._capture)
        finally:
            self._capture.release()

    def _grab(self, capture: cv2.VideoCapture) -> None:
        while not self._over.is_set():
            if not capture.grab():
                self._over.wait(0.02)
                continue
            now = time.monotonic_ns()  # before decoding: the picture is as old as this
            there, image = capture.retrieve()
            if there:
                with self._arrived:
                    self._frames.append((np.asarray(image, np.uint8), now))
                    self._heard = now
                    self._arrived.notify_all()


# Cameras side by side, each in a thread of its own.

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@contextmanager
def one_thread_per_call(wanted: bool = True) -> Iterator[None]:
    """OpenCV does not share a call's work out among threads of its own meanwhile: callers that are
    threads already would wait for each other, twice as long as the work takes."""
    threads = cv2.getNumThreads()
    if wanted:
        cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def in_threads(
    work: Callable[[_Item, threading.Event], _Result], items: Sequence[_Item], at_most: int
) -> list[_Result]:
    """`work` on all items, `at_most` at once. It is also given an event, which is set when the
    others need not finish: after an error in one, which is raised here, or an interruption."""
    stop = threading.Event()
    with one_thread_per_call(), ThreadPoolExecutor(min(len(items), at_most)) as pool:
        jobs = [pool.submit(work, item, stop) for item in items]
        try:
            return [job.result() for job in jobs]
        except BaseException:
            stop.set()
            raise


_IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")
_LATE = 1.5  # periods without a frame that are a gap


@dataclass(frozen=True)
class Timing:
    """What the time stamps of t frames say: their median `period`, s; how many frames are `missing`
    in gaps, how many came twice with one stamp (`repeated`), and how often time went back."""

    period: float
    missing: int
    repeated: int
    back: int


def timing(time: Float) -> Timing:
    """Of stamps (t,) s."""
    step = np.diff(time)
    if not len(step) or not (step > 0).any():
        return Timing(0.0, 0, int((step == 0).sum()), int((step < 0).sum()))
    period = float(np.median(step[step > 0]))
    gaps = step[step > _LATE * period]
    missing = int((np.round(gaps / period) - 1).sum())
    return Timing(period, missing, int((step == 0).sum()), int((step < 0).sum()))


class Video:
    """The frames of a file, one after the other; the times of images come from `rate`, Hz."""

    def __init__(self, path: Path, rate: float | None = None) -> None:
        """Raises CaptureError for what is no video, and for images without a rate."""
        self.path, self._rate = path, rate
        self._files: list[Path] = []
        self._capture: cv2.VideoCapture | None = None
        pattern = "%" in path.name
        if path.is_dir():
            images = (p for p in path.iterdir() if p.suffix.lower() in _IMAGES)
            self._files = sorted(images, key=_by_number)
            if not self._files:
                raise CaptureError(
                    f"{path}: the folder has no images ({', '.join(_IMAGES)})",
                    code="images-missing",
                )
        elif not path.exists() and not pattern:
            raise CaptureError(f"{path}: there is no such file", code="file-not-found")
        if (self._files or pattern) and rate is None:
            raise CaptureError(
                f"{path}: images have no time stamps; give the frames per second at which they were"
                " taken with --rate",
                code="frame-rate-missing",
            )
        if self._files:
            self.expected = len(self._files)
            first = _image(self._files[0])
            self.size = first.shape[1], first.shape[0]
            return
        quiet()
        self._capture = cv2.VideoCapture(str(path))
        width, height = (
            int(self._capture.get(k)) for k in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        count = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        if not self._capture.isOpened() or min(width, height) < 1:
            raise CaptureError(
                f"{path}: cannot be opened as a video; check that it is one and is not damaged",
                code="video-unreadable",
            )
        self.size = width, height
        #: Frames that the file says it has; 0 where it does not say.
        self.expected = int(count) if np.isfinite(count) and 0 < count < 1e9 else 0

    def frames(self) -> Iterator[tuple[int, float, Image]]:
        """Number, time s and image of each frame that can be read."""
        if self._files:
            for k, file in enumerate(self._files):
                yield k, k / (self._rate or 1.0), _image(file)
            return
        assert self._capture is not None
        k = 0
        while True:
            there, image = self._capture.read()
            if not there:
                return
            time = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
            yield k, k / self._rate if self._rate else time, np.asarray(image, np.uint8)
            k += 1

    def close(self) -> None:
        """Let go of the file."""
        if self._capture is not None:
            self._capture.release()


def _by_number(path: Path) -> tuple[list[str | int], str]:
    """For a9 to come before a10."""
    parts = re.split(r"(\d+)", path.name)
    return [int(p) if k % 2 else p for k, p in enumerate(parts)], path.name


def _image(path: Path) -> Image:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise CaptureError(
            f"{path}: cannot be read as an image; check that it is one and is not damaged",
            code="image-unreadable",
            file=path.name,
        )
    return np.asarray(image, np.uint8)


def quiet() -> None:
    """OpenCV and FFmpeg write to standard error by themselves; errors are told in our words."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
