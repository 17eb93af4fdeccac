"""Simulated cameras that deliver images: rendered on demand, or live by the computer's clock.

`expose` gives them the motion during an exposure: smear while the shutter is open, and the rows of
a rolling shutter.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ...core.mesh import Surface
from ..scenes.scene import Scene
from .camera_optics import Optics
from .renderer import Renderer

BUFFERED_FRAMES = 2  # unread frames; older ones are dropped, as drivers do
LOGGED_FRAMES = 100_000
SHUTTER_ITERATIONS = 3  # of the fixed point between position and readout time
MIN_SMEAR_PX = 0.05  # shorter smears are not rendered
INSTANT_SPACING_PX = 0.5
MAX_INSTANTS = 13


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


def expose(
    scene_at: Callable[[float], Scene], camera: Camera, time: float, optics: Optics
) -> tuple[Scene, list[Scene]]:
    """Return what a camera sees during an exposure.

    Patches move evenly along a line through their true position in the middle of the exposure, a
    fraction of a pixel from instant to instant; everything else stays. With a rolling shutter each
    patch, the LED and each vertex of the body are as they are when their row is read.

    Args:
        scene_at: Returns the scene at a time, s.
        camera: The camera.
        time: Middle of the exposure, s.
        optics: Exposure time and readout time of the camera.

    Returns:
        The scene in the middle of the exposure, and the scenes at instants of the exposure; the
        list is empty if no patch moves.
    """
    middle = scene_at(time)
    span = max(optics.exposure, optics.readout_time) / 2
    if span <= 0 or not middle.patches:
        return middle, []
    after = scene_at(time + span)
    if len(after.patches) != len(middle.patches):
        return middle, []
    poses, later = (
        np.stack([np.column_stack([p.center, p.axes]) for p in s.patches]) for s in (middle, after)
    )
    speed = (later - poses) / span
    if optics.readout_time:
        delay = np.zeros(len(poses))
        for _ in range(SHUTTER_ITERATIONS):
            centers = poses[:, :, 0] + delay[:, None] * speed[:, :, 0]
            delay = _readout_delay(camera, centers, optics.readout_time)
        poses = poses + delay[:, None, None] * speed
        moved = _place_patches(middle, poses)
        middle = _roll_body_and_led(moved, after, scene_at, camera, time, span, optics)
    half = optics.exposure / 2 * speed
    corners = (
        np.stack([p.corners for p in s.patches])
        for s in (middle, _place_patches(middle, poses + half))
    )
    first, last = (camera.project(c) for c in corners)
    smear = 2 * float(np.nanmax(np.linalg.norm(last - first, axis=-1), initial=0.0))
    if not smear > MIN_SMEAR_PX:
        return middle, []
    count = int(np.clip(np.ceil(smear / INSTANT_SPACING_PX), 2, MAX_INSTANTS))
    # The spacing gives the instants the variance of an even smear.
    offsets = ((2 * np.arange(count) + 1) / count - 1) / np.sqrt(1 - 1 / count**2)
    return middle, [_place_patches(middle, poses + o * half) for o in offsets]


def _place_patches(scene: Scene, poses: Float) -> Scene:
    """Return the scene with its patches at poses (m, 3, 4): centers and approximate axes."""
    placed = zip(scene.patches, poses[:, :, 0], _nearest_rotations(poses[:, :, 1:]), strict=True)
    return scene.replace(patches=tuple(p.moved_to(center, axes) for p, center, axes in placed))


def _readout_delay(camera: Camera, points: Float, readout_time: float) -> Float:
    """Return when the rows of points (n, 3) mm are read, s (n,) after the middle row."""
    height = camera.size[1]
    row = np.nan_to_num(camera.project(points)[:, 1], nan=height / 2)
    return np.asarray(readout_time * (np.clip(row, 0, height) / height - 0.5))


def _roll_body_and_led(
    scene: Scene,
    after: Scene,
    scene_at: Callable[[float], Scene],
    camera: Camera,
    time: float,
    span: float,
    optics: Optics,
) -> Scene:
    """Return the scene with the body and the LED as a rolling shutter sees them."""
    body, led = scene.body, scene.led
    if body is not None and after.body is not None:
        delay = _readout_delay(camera, body.vertices, optics.readout_time)[:, None]
        speed = (after.body.vertices - body.vertices) / span
        body = Surface(body.vertices + delay * speed, body.faces)
    if led is not None:
        led_delay = float(_readout_delay(camera, led.center[None], optics.readout_time)[0])
        led = scene_at(time + led_delay).led
    return scene.replace(body=body, led=led)


def _nearest_rotations(axes: Float) -> Float:
    """Return the rotations (m, 3, 3) nearest to near-rotations, by Newton's method."""
    for _ in range(3):
        axes = axes @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(axes, 1, 2) @ axes)
    return axes
