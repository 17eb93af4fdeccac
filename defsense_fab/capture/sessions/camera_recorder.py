"""Record the tags that one camera sees, in a thread."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2

from ...core.camera import Camera
from ...core.errors import CaptureError, StorageError
from ..cameras.image_sources import ImageSource
from ..clocks.led_detection import LedDetector
from ..tags.detection import Image, TagFollower, TagView, to_grey
from ..tags.tag_patterns import Dictionary
from .session import FRAME_COLUMNS, TAG_COLUMNS, Log, Stream, format_tags

VIDEO_RATE_HZ = 30.0  # by which videos count frames; their times are in the frames' file
MIN_FREE_BYTES = 500e6  # left by a video, which does not report a full disk as other streams do
THREAD_JOIN_TIMEOUT_S = 5.0
REOPEN_INTERVAL_S = 1.0  # after a camera was disconnected
DISK_CHECK_FRAMES = 100
LED_MARGIN_PX = 3  # around the LED, over which its brightness is averaged


@dataclass(frozen=True)
class CameraFrame:
    """The newest image of a camera.

    Attributes:
        frame: Number of the frame.
        host_ns: When it was taken, ns.
        view: Tags in the image.
        image: The image.
    """

    frame: int
    host_ns: int
    view: TagView
    image: Image


class CameraRecorder:
    """Records a camera until it is closed; continues after the camera was disconnected.

    Args:
        opener: Opens the camera.
        camera: Calibration of the camera.
        tags: Family of the tags.
        run: Folder of the run.
        log: Log of the run.
        video: Whether to record a video too.

    Attributes:
        frames: Number of recorded frames.
        late: Number of frames that were late or lost.
        repeated: Number of repeated images.
        is_disconnected: Whether the camera is disconnected.
        latest: The newest frame.
        failure: Error that ended the thread.
    """

    def __init__(
        self,
        opener: Callable[[], ImageSource],
        camera: Camera,
        tags: Dictionary,
        run: Path,
        log: Log,
        *,
        video: bool = False,
    ) -> None:
        self.camera = camera
        self._opener, self._follower, self._log = opener, TagFollower(camera, tags), log
        self._source: ImageSource | None = None
        self._tags = Stream(run / f"{camera.name}.csv", TAG_COLUMNS)
        self._frames = Stream(run / f"{camera.name}-frames.csv", FRAME_COLUMNS)
        self._video: cv2.VideoWriter | None = None
        self._video_path = run / f"{camera.name}.mkv" if video else None
        self._led = LedDetector()
        self._led_pixel: tuple[int, int] | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.frames = self.late = self.repeated = 0
        self.is_disconnected = False
        self.latest: CameraFrame | None = None
        self.failure: Exception | None = None
        self._closing_error: Exception | None = None  # error while closing
        self._last_ns = 0
        self._period = 0.0

    def start(self) -> None:
        """Open the camera and start the thread.

        Raises:
            CaptureError: If the camera cannot be opened, or has another resolution.
            StorageError: If the video cannot be written.
        """
        self._source = self._open()
        if self._video_path is not None:
            code = cv2.VideoWriter.fourcc(*"FFV1")
            self._video = cv2.VideoWriter(
                str(self._video_path), code, VIDEO_RATE_HZ, self.camera.size, False
            )
            if not self._video.isOpened():
                raise StorageError(
                    "cannot be written",
                    code="video-unwritable",
                    where=self._video_path,
                    action="Record without video",
                )
        self._thread.start()

    @property
    def rate(self) -> float:
        """Recent frames per second."""
        return 1 / self._period if self._period else 0.0

    def close(self) -> None:
        """Stop the thread, which closes the camera and the files.

        A thread that hangs in the camera's driver closes them when it returns.

        Raises:
            StorageError: If the data do not reach the disk.
        """
        self._stop.set()
        if self._thread.ident is None:
            self._release()
            return
        self._thread.join(THREAD_JOIN_TIMEOUT_S)
        if self._thread.is_alive():
            self._log.event("camera hangs", camera=self.camera.name)
            return
        if self.repeated:
            self._log.event("repeated", camera=self.camera.name, pictures=self.repeated)
        if self._closing_error is not None:
            raise self._closing_error

    def _release(self) -> None:
        with ExitStack() as stack:  # close each, even if another fails
            stack.callback(self._frames.close)
            stack.callback(self._tags.close)
            if self._video is not None:
                stack.callback(self._video.release)
            if self._source is not None:
                stack.callback(self._source.close)

    def _open(self) -> ImageSource:
        source = self._opener()
        source.start()
        if source.size != self.camera.size:
            source.close()
            raise CaptureError(
                f"gives {source.size[0]} x {source.size[1]} pixels, but its calibration is for"
                f" {self.camera.size[0]} x {self.camera.size[1]}",
                code="image-size-differs",
                where=f"camera {self.camera.name}",
                action="Calibrate it at this resolution",
                camera=self.camera.name,
                size=source.size,
            )
        return source

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                if self._source is None:
                    self._reopen()
                    continue
                try:
                    frame = self._source.read(0.5)
                except CaptureError as error:
                    self._log.event("camera gone", camera=self.camera.name, why=str(error))
                    self.is_disconnected = True
                    self._source.close()
                    self._source = None
                    continue
                if frame is not None:
                    self._record(*frame)
        except Exception as error:  # mostly of the disk; raised by who checks `failure`
            self.failure = error
        finally:
            try:
                self._release()
            except Exception as error:
                self._closing_error = error

    def _reopen(self) -> None:
        try:
            self._source = self._open()
        except CaptureError:
            self._stop.wait(REOPEN_INTERVAL_S)
            return
        self.is_disconnected = False
        self._log.event("camera back", camera=self.camera.name)

    def _record(self, image: Image, host_ns: int) -> None:
        if host_ns <= self._last_ns:
            self.repeated += 1  # a repeated image, or a clock that jumped
            return
        grey = to_grey(image)
        view = self._follower.find(grey)
        led = self._brightness(grey)
        number = self.frames
        if self._last_ns:
            step = (host_ns - self._last_ns) / 1e9
            if self._period and step > 1.6 * self._period:
                self.late += max(round(step / self._period) - 1, 0)
            self._period = step if not self._period else 0.95 * self._period + 0.05 * step
        self._last_ns = host_ns
        rows = format_tags(number, host_ns, view)
        if rows:
            self._tags.line(rows)
        self._frames.line(f"{number},{host_ns},{led:.2f}")
        if self._video is not None:
            self._video.write(grey)
            if self.frames % DISK_CHECK_FRAMES == 0:
                self._check_disk()
        self.frames += 1
        self.latest = CameraFrame(number, host_ns, view, image)

    def _check_disk(self) -> None:
        assert self._video_path is not None
        if shutil.disk_usage(self._video_path.parent).free < MIN_FREE_BYTES:
            raise StorageError(
                "the disk is nearly full; the recording so far is complete",
                code="disk-full",
                where=self._video_path,
                action="Free disk space or record without video, and run the command again",
            )

    def _brightness(self, grey: Image) -> float:
        """Return the brightness of the read-out board's LED, NaN until it is located."""
        if self._led_pixel is None:
            place = self._led.add(grey)
            if place is not None:
                self._led_pixel = (round(float(place[0])), round(float(place[1])))
                self._log.event("led", camera=self.camera.name, place=list(self._led_pixel))
            return float("nan")
        x, y = self._led_pixel
        window = grey[
            max(y - LED_MARGIN_PX, 0) : y + LED_MARGIN_PX + 1,
            max(x - LED_MARGIN_PX, 0) : x + LED_MARGIN_PX + 1,
        ]
        return float(window.mean())

    def fresh(self, max_age: float) -> CameraFrame | None:
        """Return the newest frame if it is not older than so many s."""
        frame = self.latest
        if frame is None or (time.monotonic_ns() - frame.host_ns) / 1e9 > max_age:
            return None
        return frame
