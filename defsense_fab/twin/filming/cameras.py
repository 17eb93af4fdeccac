"""A twin camera that runs: frames as they come, by the clock of this computer."""

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

# A twin camera that takes as long as it needs: pictures are rendered when they are asked for.


class RenderedCamera:
    """`Images` of `scene_at`(s) at `moments`: times, s, and the stamps, ns, that pictures get.
    After the last one it is `finished`, and reads nothing more."""

    def __init__(
        self, camera: Camera, scene_at: Callable[[float], Scene], optics: Optics,
        rng: np.random.Generator, moments: Iterator[tuple[float, int]],
    ) -> None:  # fmt: skip
        self.name, self.size = camera.name, camera.size
        self.finished = threading.Event()
        self._camera, self._scene_at, self._optics, self._rng = camera, scene_at, optics, rng
        self._moments, self._closed = moments, threading.Event()
        self._renderer: Renderer | None = None

    def start(self) -> None:
        self._renderer = Renderer(self._camera, self._optics, self._rng)

    def read(self, timeout: float) -> tuple[NDArray[np.uint8], int] | None:
        """As `Images` has it; raises what `moments` raise."""
        assert self._renderer is not None
        at, stamp = next(self._moments, (0.0, -1))
        if stamp < 0:
            self.finished.set()
            self._closed.wait(timeout)
            return None
        scene, instants = expose(self._scene_at, self._camera, at, self._optics)
        return self._renderer.shoot(scene, instants, at).image, stamp

    def close(self) -> None:
        self._closed.set()
        self._renderer = None


_KEPT = 2  # frames that wait to be read; older ones are lost, as with a driver
_LOGGED = 100_000


class LiveCamera:
    """Takes up to `rate` frames/s of `scene_at`(s), in its own thread. Seconds count from
    `began_ns` of time.monotonic_ns: the same for all cameras of one scene. Frames are stamped at
    the middle of their exposure and `delay` s, and up to `jitter` s more, later; cameras of another
    `phase`, parts of a frame, expose at other instants."""

    def __init__(
        self,
        camera: Camera,
        scene_at: Callable[[float], Scene],
        optics: Optics,
        rng: np.random.Generator,
        began_ns: int,
        rate: float = 30.0,
        delay: float = 0.002,
        jitter: float = 0.0,
        phase: float = 0.0,
    ) -> None:
        self.name, self.size = camera.name, camera.size
        self.began_ns = began_ns
        #: Stamps of frames, ns, and the true seconds of their middle: the last ones.
        self.taken: deque[tuple[int, float]] = deque(maxlen=_LOGGED)
        self._camera, self._scene_at, self._optics, self._rng = camera, scene_at, optics, rng
        self._rate, self._delay, self._jitter, self._phase = rate, delay, jitter, phase
        self._frames: deque[tuple[NDArray[np.uint8], int]] = deque(maxlen=_KEPT)
        self._arrived = threading.Condition()
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self._problem: Exception | None = None

    def start(self) -> None:
        """From here on frames are taken."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"twin {self.name}", daemon=True)
            self._thread.start()

    def read(self, timeout: float) -> tuple[NDArray[np.uint8], int] | None:
        """The next frame (h, w) and its stamp, ns of time.monotonic_ns; None where there is none
        within so many s. Raises CaptureError where the scene has failed."""
        with self._arrived:
            self._arrived.wait_for(
                lambda: self._frames or self._problem or self._over.is_set(), timeout
            )
            if self._frames:
                return self._frames.popleft()
            if self._problem is not None:
                raise CaptureError(
                    f"the scene failed: {self._problem}",
                    code="scene-failed",
                    where=f"twin camera {self.name}",
                    camera=self.name,
                ) from self._problem
        return None

    def close(self) -> None:
        """Take no more frames."""
        with self._arrived:
            self._over.set()
            self._arrived.notify_all()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        try:
            renderer = Renderer(self._camera, self._optics, self._rng)
            while not self._over.is_set():
                self._take(renderer)
        except Exception as problem:  # whatever the scene does, the reader must learn of it
            with self._arrived:
                self._problem = problem
                self._arrived.notify_all()

    def _take(self, renderer: Renderer) -> None:
        """The next frame that can still be on time."""
        now = (time.monotonic_ns() - self.began_ns) * 1e-9
        at = (np.floor(now * self._rate - self._phase) + 1 + self._phase) / self._rate
        due = at + self._optics.exposure / 2
        if self._over.wait(max(due - now, 0.0)):
            return
        scene, instants = expose(self._scene_at, self._camera, float(at), self._optics)
        image = renderer.shoot(scene, instants, float(at)).image
        late = self._delay + self._jitter * self._rng.random()
        stamp = self.began_ns + round((at + late) * 1e9)
        with self._arrived:
            self._frames.append((image, stamp))
            self.taken.append((stamp, float(at)))
            self._arrived.notify_all()
