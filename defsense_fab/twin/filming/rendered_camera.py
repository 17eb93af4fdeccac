"""A twin camera that takes as long as it needs: pictures are rendered when they are asked for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ..scenes.scene import Scene
from .exposure import exposed
from .renderer import Optics, Renderer


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
        scene, instants = exposed(self._scene_at, self._camera, at, self._optics)
        return self._renderer.shoot(scene, instants, at).image, stamp

    def close(self) -> None:
        self._closed.set()
        self._renderer = None
