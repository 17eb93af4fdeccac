"""Sources of images: video files, folders of images, and cameras that are plugged in.

Several sources can be read at once, each in its own thread.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

import cv2
import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ..tags.detection import Image
from .image_files import list_images, list_numbered_images, read_image, read_orientation
from .packet_sizes import Size, read_packet_sizes

MAX_WAITING_FRAMES = 4  # older frames are dropped
THREAD_JOIN_TIMEOUT_S = 3.0
DISCONNECT_TIMEOUT_S = 2.0  # without a frame
#: By operating system; on Windows OpenCV's first choice takes many seconds to open a camera.
_BACKENDS = {"win32": cv2.CAP_DSHOW, "darwin": cv2.CAP_AVFOUNDATION}


class ImageSource(Protocol):
    """A source of frames as they are taken: an interface.

    Call `start` first and `close` last.

    Attributes:
        name: Name of the source in messages.
        size: Width and height of the frames, px.
    """

    name: str
    size: tuple[int, int]

    def start(self) -> None:
        """Start taking frames.

        Raises:
            CaptureError: If there is no camera.
        """

    def read(self, timeout: float) -> tuple[Image, int] | None:
        """Wait for the next frame.

        Args:
            timeout: Longest time to wait, s.

        Returns:
            The frame, (h, w) or (h, w, 3), and the monotonic clock at which it was taken, ns; None
            if none came in time.

        Raises:
            CaptureError: If the camera was disconnected.
        """

    def close(self) -> None: ...


class Webcam:
    """An `ImageSource` that reads a camera in its own thread.

    Frames that are not read in time are dropped, oldest first.

    Args:
        address: Index (`0`) or device (`/dev/video0`) of the camera.
        size: Requested width and height, px; 1280 x 720 by default.
    """

    def __init__(self, address: str, size: tuple[int, int] | None = None) -> None:
        self.name, self.size = address, size or (1280, 720)
        self._capture: cv2.VideoCapture | None = None
        self._frames: deque[tuple[Image, int]] = deque(maxlen=MAX_WAITING_FRAMES)
        self._frame_arrived, self._stop = threading.Condition(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._last_frame_ns = 0

    def start(self) -> None:
        silence_opencv()
        index = int(self.name) if self.name.isdigit() else self.name
        self._capture = cv2.VideoCapture(index, _BACKENDS.get(sys.platform, cv2.CAP_ANY))
        if not self._capture.isOpened():
            self._capture.release()
            raise CaptureError(
                "cannot be opened",
                code="camera-unavailable",
                where=f"camera {self.name}",
                action=(
                    "Plug it in, close other programs that use it (a browser, a meeting), or run"
                    " defsense doctor for details"
                ),
                camera=self.name,
            )
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self.size[0])
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self.size[1])
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        has_image, image = self._capture.read()
        if not has_image:
            self._capture.release()
            raise CaptureError(
                "gives no image",
                code="camera-gives-no-image",
                where=f"camera {self.name}",
                action="Plug it in again, or choose another camera",
                camera=self.name,
            )
        self.size = (image.shape[1], image.shape[0])
        self._last_frame_ns = time.monotonic_ns()
        self._thread.start()

    def read(self, timeout: float) -> tuple[Image, int] | None:
        with self._frame_arrived:
            self._frame_arrived.wait_for(lambda: bool(self._frames), timeout)
            if self._frames:
                return self._frames.popleft()
        if time.monotonic_ns() - self._last_frame_ns > DISCONNECT_TIMEOUT_S * 1e9:
            raise CaptureError(
                "gives no more images",
                code="camera-disconnected",
                where=f"camera {self.name}",
                action="Check that it is plugged in",
                camera=self.name,
            )
        return None

    def close(self) -> None:
        """Stop the thread, which releases the camera.

        A thread that hangs in its driver releases the camera when it returns.
        """
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(THREAD_JOIN_TIMEOUT_S)
        elif self._capture is not None:
            self._capture.release()

    def _run(self) -> None:
        assert self._capture is not None
        try:
            self._grab(self._capture)
        finally:
            self._capture.release()

    def _grab(self, capture: cv2.VideoCapture) -> None:
        while not self._stop.is_set():
            if not capture.grab():
                self._stop.wait(0.02)
                continue
            now = time.monotonic_ns()  # before decoding, because the image is as old as this
            has_image, image = capture.retrieve()
            if has_image:
                with self._frame_arrived:
                    self._frames.append((np.asarray(image, np.uint8), now))
                    self._last_frame_ns = now
                    self._frame_arrived.notify_all()


_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@contextmanager
def one_thread_per_call(is_enabled: bool = True) -> Iterator[None]:
    """Keep OpenCV from dividing a call's work among threads of its own.

    Callers that are threads themselves would wait for each other, and take twice as long.

    Args:
        is_enabled: Whether to do so.
    """
    threads = cv2.getNumThreads()
    if is_enabled:
        cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def run_in_threads(
    work: Callable[[_Item, threading.Event], _Result], items: Sequence[_Item], max_threads: int
) -> list[_Result]:
    """Run a function on all items in threads.

    Args:
        work: Function of an item and an event. The event is set when the result is no longer
            needed: after an error in another item, or an interruption.
        items: Items to process.
        max_threads: Largest number of threads.

    Returns:
        The results, in the order of the items.
    """
    stop = threading.Event()
    with one_thread_per_call(), ThreadPoolExecutor(min(len(items), max_threads)) as pool:
        jobs = [pool.submit(work, item, stop) for item in items]
        try:
            return [job.result() for job in jobs]
        except BaseException:
            stop.set()
            raise


GAP_PERIODS = 1.5  # a longer step between frames is a gap


@dataclass(frozen=True)
class Timing:
    """Regularity of t time stamps.

    Attributes:
        period: Median period, s.
        missing: Number of frames missing in gaps.
        repeated: Number of frames with the stamp of the previous one.
        back: Number of times that time went back.
    """

    period: float
    missing: int
    repeated: int
    back: int


def measure_timing(time: Float) -> Timing:
    """Measure the regularity of stamps (t,), s."""
    step = np.diff(time)
    if not len(step) or not (step > 0).any():
        return Timing(0.0, 0, int((step == 0).sum()), int((step < 0).sum()))
    period = float(np.median(step[step > 0]))
    gaps = step[step > GAP_PERIODS * period]
    missing = int((np.round(gaps / period) - 1).sum())
    return Timing(period, missing, int((step == 0).sum()), int((step < 0).sum()))


class Video:
    """The frames of a video, a folder of images, or numbered images.

    Args:
        path: Video, folder, or pattern such as `a%04d.png`.
        rate: Frames per second, Hz; required for images.

    Raises:
        CaptureError: If there is nothing to read, or images have no rate.
    """

    def __init__(self, path: Path, rate: float | None = None) -> None:
        self.path, self._rate = path, rate
        self._files: dict[int, Path] = {}  # images by number
        self._orientation = 1
        self._capture: cv2.VideoCapture | None = None
        is_pattern = "%" in path.name and not path.exists()
        if path.is_dir():
            self._files = dict(enumerate(list_images(path)))
        elif is_pattern:
            self._files = list_numbered_images(path)
        elif not path.exists():
            raise CaptureError(
                "there is no such file",
                code="file-not-found",
                where=path,
                action="Check the file's name",
            )
        if self._files:
            if rate is None:
                raise CaptureError(
                    "images have no time stamps",
                    code="frame-rate-missing",
                    where=path,
                    action="Give the frames per second at which they were taken (rate)",
                )
            self.expected = len(self._files)
            self._first = next(iter(self._files.values()))
            self._orientation = read_orientation(self._first)
            first = read_image(self._first, self._orientation)
            self.size = first.shape[1], first.shape[0]
            return
        silence_opencv()
        self._capture = cv2.VideoCapture(str(path))
        width, height = (
            int(self._capture.get(k)) for k in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        count = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        if not self._capture.isOpened() or min(width, height) < 1:
            raise CaptureError(
                "cannot be opened as a video",
                code="video-unreadable",
                where=path,
                action="Check that it is a video and is not damaged",
            )
        self.size = width, height
        #: Number of frames that the file states; 0 if it states none.
        self.expected = int(count) if np.isfinite(count) and 0 < count < 1e9 else 0

    def frames(self) -> Iterator[tuple[int, float, Image]]:
        """Yield number, time, s, and image of each frame that can be read.

        Raises:
            CaptureError: If an image or a picture of the video has another size than the first one
                (`image-sizes-differ`), or a file is not an image (`image-unreadable`).
        """
        numbers = list(self._files)
        for k, file in enumerate(self._files.values()):
            image = read_image(file, self._orientation)
            self._check_size(image, file)
            yield k, (numbers[k] - numbers[0]) / (self._rate or 1.0), image
        if self._capture is None:
            return
        with closing(self._check_packets()) as checked:
            k = 0
            while True:
                next(checked, None)
                has_image, image = self._capture.read()
                if not has_image:
                    break
                time = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
                yield k, k / self._rate if self._rate else time, np.asarray(image, np.uint8)
                k += 1
            for _ in checked:  # packets without a picture
                pass

    def _check_packets(self) -> Generator[None]:
        """Check the size of the pictures of a video, packet by packet."""
        first: Size | None = None
        for k, (stamp, size) in enumerate(read_packet_sizes(self.path)):
            first = first or size
            if size != first and size is not None and first is not None:
                at = k / self._rate if self._rate else stamp
                raise CaptureError(
                    f"the size of its pictures changes at frame {k} ({at:.3f} s) from"
                    f" {first[0]} x {first[1]} to {size[0]} x {size[1]} pixels",
                    code="image-sizes-differ",
                    where=self.path,
                    action="Record at one resolution, or cut the video there and use one part",
                    frame=k,
                    time=at,
                    size=size,
                    expected=first,
                )
            yield

    def _check_size(self, image: Image, file: Path) -> None:
        size = image.shape[1], image.shape[0]
        if size == self.size:
            return
        turned = ": it was turned by 90 degrees" if size == self.size[::-1] else ""
        raise CaptureError(
            f"has {size[0]} x {size[1]} pixels, but {self._first.name} has"
            f" {self.size[0]} x {self.size[1]}{turned}",
            code="image-sizes-differ",
            where=file,
            action="Use images of one camera at one resolution, not scaled, cropped or turned",
            file=file.name,
            size=size,
            expected=self.size,
        )

    def close(self) -> None:
        """Release the file."""
        if self._capture is not None:
            self._capture.release()


def silence_opencv() -> None:
    """Keep OpenCV and FFmpeg from writing to standard error; errors are raised instead."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
