"""Simulated cameras that deliver images: rendered on demand, or live by the computer's clock."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.errors import CaptureError
from ..scenes.scene import Scene
from .camera_optics import Optics
from .exposure import expose
from .renderer import Renderer

BUFFERED_FRAMES = 2  # unread frames; older ones are dropped, as drivers do
LOGGED_FRAMES = 100_000


class RenderedCamera:
    """A camera that renders every image when it is read, however long that takes.

    It has the interface `Images` of the cameras that are recorded.

    Args:
        camera: The camera.
        scene_at: Returns the scene at a time, s.
        optics: Lens, shutter and sensor of the camera.
        rng: Random generator of the noise.
        moments: Times of the images, s, and their time stamps, ns.

    Attributes:
        finished: Set after the last image.
    """

    def __init__(
        self,
        camera: Camera,
        scene_at: Callable[[float], Scene],
        optics: Optics,
        rng: np.random.Generator,
        moments: Iterator[tuple[float, int]],
    ) -> None:
        self.name, self.size = camera.name, camera.size
        self.finished = threading.Event()
        self._camera, self._scene_at, self._optics, self._rng = camera, scene_at, optics, rng
        self._moments, self._closed = moments, threading.Event()
        self._renderer: Renderer | None = None

    def start(self) -> None:
        """Prepare the renderer."""
        self._renderer = Renderer(self._camera, self._optics, self._rng)

    def read(self, timeout: float) -> tuple[NDArray[np.uint8], int] | None:
        """Return the next image (h, w) and its time stamp, ns; None after the last one.

        Errors of `moments` are raised here.
        """
        assert self._renderer is not None
        seconds, stamp = next(self._moments, (0.0, -1))
        if stamp < 0:
            self.finished.set()
            self._closed.wait(timeout)
            return None
        scene, instants = expose(self._scene_at, self._camera, seconds, self._optics)
        return self._renderer.shoot(scene, instants, seconds).image, stamp

    def close(self) -> None:
        """Release the renderer."""
        self._closed.set()
        self._renderer = None


class LiveCamera:
    """A camera that renders images in its own thread, by the computer's clock.

    Frames that cannot be rendered in time are skipped.

    Args:
        camera: The camera.
        scene_at: Returns the scene at a time, s.
        optics: Lens, shutter and sensor of the camera.
        rng: Random generator of the noise and the jitter.
        started_ns: Value of `time.monotonic_ns` at 0 s, the same for all cameras of a scene.
        rate: Highest frame rate, Hz.
        delay: Delay of a time stamp after the middle of the exposure, s.
        jitter: Largest additional random delay, s.
        phase: Shift of the exposures, as a share of a frame.

    Attributes:
        frame_times: Time stamp, ns, and true middle of the exposure, s, of the last frames.
    """

    def __init__(
        self,
        camera: Camera,
        scene_at: Callable[[float], Scene],
        optics: Optics,
        rng: np.random.Generator,
        started_ns: int,
        rate: float = 30.0,
        delay: float = 0.002,
        jitter: float = 0.0,
        phase: float = 0.0,
    ) -> None:
        self.name, self.size = camera.name, camera.size
        self.started_ns = started_ns
        self.frame_times: deque[tuple[int, float]] = deque(maxlen=LOGGED_FRAMES)
        self._camera, self._scene_at, self._optics, self._rng = camera, scene_at, optics, rng
        self._rate, self._delay, self._jitter, self._phase = rate, delay, jitter, phase
        self._frames: deque[tuple[NDArray[np.uint8], int]] = deque(maxlen=BUFFERED_FRAMES)
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._error: Exception | None = None

    def start(self) -> None:
        """Start the thread that takes frames."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"twin {self.name}", daemon=True)
            self._thread.start()

    def read(self, timeout: float) -> tuple[NDArray[np.uint8], int] | None:
        """Return the next frame.

        Args:
            timeout: Longest time to wait, s.

        Returns:
            The image (h, w) and its time stamp, ns of `time.monotonic_ns`; None if there is none.

        Raises:
            CaptureError: The scene failed (`scene-failed`).
        """
        with self._changed:
            self._changed.wait_for(
                lambda: self._frames or self._error or self._stop.is_set(), timeout
            )
            if self._frames:
                return self._frames.popleft()
            if self._error is not None:
                raise CaptureError(
                    f"the scene failed: {self._error}",
                    code="scene-failed",
                    where=f"twin camera {self.name}",
                    camera=self.name,
                ) from self._error
        return None

    def close(self) -> None:
        """Stop the thread."""
        with self._changed:
            self._stop.set()
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        try:
            renderer = Renderer(self._camera, self._optics, self._rng)
            while not self._stop.is_set():
                self._take_frame(renderer)
        except Exception as error:  # the reader must learn of any failure of the scene
            with self._changed:
                self._error = error
                self._changed.notify_all()

    def _take_frame(self, renderer: Renderer) -> None:
        """Take the next frame that can be on time."""
        now = (time.monotonic_ns() - self.started_ns) * 1e-9
        middle = (np.floor(now * self._rate - self._phase) + 1 + self._phase) / self._rate
        end = middle + self._optics.exposure / 2
        if self._stop.wait(max(end - now, 0.0)):
            return
        scene, instants = expose(self._scene_at, self._camera, float(middle), self._optics)
        image = renderer.shoot(scene, instants, float(middle)).image
        delay = self._delay + self._jitter * self._rng.random()
        stamp = self.started_ns + round((middle + delay) * 1e9)
        with self._changed:
            self._frames.append((image, stamp))
            self.frame_times.append((stamp, float(middle)))
            self._changed.notify_all()
