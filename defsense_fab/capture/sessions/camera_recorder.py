"""A thread that looks at one camera and writes down what it sees, as it comes."""

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
from .session import FRAME_COLUMNS, TAG_COLUMNS, Log, Stream, tag_lines

FILM_RATE = 30.0  # at which videos count frames; their times are in the frames' file
_ROOM = 500e6  # bytes that a video leaves free: other streams say so when the disk is full, it not
_HANGS = 5.0  # s after which a thread that does not come back is left to itself
_AGAIN = 1.0  # s between attempts to open a camera that vanished
_OFTEN = 100  # frames between looks at the room that is left
_AROUND = 3  # px around it that are taken for its brightness


@dataclass(frozen=True)
class CameraFrame:
    """The last picture: its number, when it was taken, ns, the tags in it, and itself."""

    frame: int
    host_ns: int
    view: TagView
    image: Image


class CameraRecorder:
    """Reads a camera until it is closed; carries on when the camera was unplugged."""

    def __init__(
        self, opener: Callable[[], ImageSource], camera: Camera, tags: Dictionary, run: Path, log: Log,
        *, video: bool = False,
    ) -> None:  # fmt: skip
        self.camera = camera
        self._opener, self._follower, self._log = opener, TagFollower(camera, tags), log
        self._source: ImageSource | None = None
        self._tags = Stream(run / f"{camera.name}.csv", TAG_COLUMNS)
        self._frames = Stream(run / f"{camera.name}-frames.csv", FRAME_COLUMNS)
        self._film: cv2.VideoWriter | None = None
        self._path = run / f"{camera.name}.mkv" if video else None
        self._led = LedDetector()
        self._spot: tuple[int, int] | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.frames = self.late = self.repeated = 0
        self.gone = False
        self.latest: CameraFrame | None = None
        self.failure: Exception | None = None
        self._unsaved: Exception | None = None  # what ended the closing
        self._last_ns = 0
        self._period = 0.0

    def start(self) -> None:
        """Raises CaptureError where the camera cannot be opened, or has another resolution."""
        self._source = self._open()
        if self._path is not None:
            code = cv2.VideoWriter.fourcc(*"FFV1")
            self._film = cv2.VideoWriter(str(self._path), code, FILM_RATE, self.camera.size, False)
            if not self._film.isOpened():
                raise StorageError(f"{self._path}: cannot be written; leave out --video")
        self._thread.start()

    @property
    def rate(self) -> float:
        """Frames per second of late."""
        return 1 / self._period if self._period else 0.0

    def close(self) -> None:
        """End the thread, which closes what it reads and writes. One that hangs in the camera's
        driver is left to itself: it does so when it comes back. Raises StorageError where what it
        wrote does not reach the disk."""
        self._over.set()
        if self._thread.ident is None:
            self._release()
            return
        self._thread.join(_HANGS)
        if self._thread.is_alive():
            self._log.event("camera hangs", camera=self.camera.name)
            return
        if self.repeated:
            self._log.event("repeated", camera=self.camera.name, pictures=self.repeated)
        if self._unsaved is not None:
            raise self._unsaved

    def _release(self) -> None:
        with ExitStack() as stack:  # each of them, whatever becomes of the others
            stack.callback(self._frames.close)
            stack.callback(self._tags.close)
            if self._film is not None:
                stack.callback(self._film.release)
            if self._source is not None:
                stack.callback(self._source.close)

    def _open(self) -> ImageSource:
        source = self._opener()
        source.start()
        if source.size != self.camera.size:
            source.close()
            raise CaptureError(
                f"camera {self.camera.name}: gives {source.size[0]} x {source.size[1]} pixels, its"
                f" calibration is for {self.camera.size[0]} x {self.camera.size[1]}; calibrate it"
                " at this resolution"
            )
        return source

    def _run(self) -> None:
        try:
            while not self._over.is_set():
                if self._source is None:
                    self._reopen()
                    continue
                try:
                    frame = self._source.read(0.5)
                except CaptureError as error:
                    self._log.event("camera gone", camera=self.camera.name, why=str(error))
                    self.gone = True
                    self._source.close()
                    self._source = None
                    continue
                if frame is not None:
                    self._take(*frame)
        except Exception as error:  # the disk, above all: told by whoever looks
            self.failure = error
        finally:
            try:
                self._release()
            except Exception as error:
                self._unsaved = error

    def _reopen(self) -> None:
        try:
            self._source = self._open()
        except CaptureError:
            self._over.wait(_AGAIN)
            return
        self.gone = False
        self._log.event("camera back", camera=self.camera.name)

    def _take(self, image: Image, host_ns: int) -> None:
        if host_ns <= self._last_ns:
            self.repeated += 1  # the same picture once more, or a clock that jumped
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
        rows = tag_lines(number, host_ns, view)
        if rows:
            self._tags.line(rows)
        self._frames.line(f"{number},{host_ns},{led:.2f}")
        if self._film is not None:
            self._film.write(grey)
            if self.frames % _OFTEN == 0:
                self._check_room()
        self.frames += 1
        self.latest = CameraFrame(number, host_ns, view, image)

    def _check_room(self) -> None:
        assert self._path is not None
        if shutil.disk_usage(self._path.parent).free < _ROOM:
            raise StorageError(
                f"{self._path}: the disk is nearly full; what was recorded is whole: make room, or"
                " leave out --video, and give the command again"
            )

    def _brightness(self, grey: Image) -> float:
        """Of the read-out board's LED, once it is known where that is."""
        if self._spot is None:
            self._led.add(grey)
            if self._led.is_located:
                found = self._led.trace()
                if found is not None:
                    self._spot = (round(float(found.place[0])), round(float(found.place[1])))
                    self._log.event("led", camera=self.camera.name, place=list(self._spot))
            return float("nan")
        x, y = self._spot
        around = grey[max(y - _AROUND, 0) : y + _AROUND + 1, max(x - _AROUND, 0) : x + _AROUND + 1]
        return float(around.mean())

    def fresh(self, within: float) -> CameraFrame | None:
        """The last picture, if it is not older than so many s."""
        glance = self.latest
        if glance is None or (time.monotonic_ns() - glance.host_ns) / 1e9 > within:
            return None
        return glance
