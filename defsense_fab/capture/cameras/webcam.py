"""A camera that is plugged in, read by a thread of its own."""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from typing import Protocol

import cv2
import numpy as np

from ...core.errors import CaptureError
from ..tags.tag_detection import Image
from .video import quiet

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
