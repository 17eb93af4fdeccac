"""The screen of a guided recording, on the page."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...capture.sessions.guided_recording import CaptureView
from ...core.arrays import Float
from ...runtime.view.live_scene import LINES
from ..workbench.workbench import Workbench
from .camera_pictures import camera_words, small_picture
from .pressed_keys import PressedKeys
from .recording_words import coverage_bars, step_words

_SECONDS = 20.0  # of signals that are drawn
_SIGNALS, _PICTURES = 0.25, 0.5  # s between two drawings


class RecordingScreen(PressedKeys):
    """A `CaptureScreen`; its handles are made in the `folder`, and taken away by `close`. Buttons
    `press` keys."""

    def __init__(self, bench: Workbench, folder: Any, channels: tuple[str, ...]) -> None:
        import viser.uplot as uplot

        super().__init__()
        gui = bench.server.gui
        self._bench = bench
        self._rows: deque[tuple[float, Float]] = deque()
        self._drawn = self._pictured = 0.0
        self._cameras: dict[str, tuple[Any, Any]] = {}
        with folder:
            self._folder = gui.add_folder("Recording")
        with self._folder:
            self._said = gui.add_markdown("Preparing ...")
            self._group("Step", {"Begin": "enter", "Again": "r", "Back": "b", "Skip": "s"})
            self._group("Recording", {"Stop": "q"})
            self._pictures = gui.add_folder(None)
            self._bars = gui.add_html("")
            series = (uplot.Series(label="s"), *(
                uplot.Series(label=name, stroke=LINES[k % len(LINES)], width=2)
                for k, name in enumerate(channels)
            ))  # fmt: skip
            empty = (np.zeros(1), *(np.zeros(1) for _ in channels))
            self._plot: Any = None
            if channels:
                self._plot = gui.add_uplot(
                    empty, series, aspect=1.6, title="(R - R0)/R0, last 20 s",
                    scales={"x": uplot.Scale(time=False, auto=True)},
                )  # fmt: skip

    def show(self, view: CaptureView) -> None:
        now = time.monotonic()
        self._rows.append((now, np.asarray(view.signals, float)))
        while now - self._rows[0][0] > _SECONDS:
            self._rows.popleft()
        if now - self._drawn < _SIGNALS and view.phase != "done":
            return
        self._drawn = now
        self._said.content = step_words(view)
        bars = coverage_bars(view.reached)
        if self._bars.content != bars:
            self._bars.content = bars
        if self._plot is not None:
            when = np.array([t for t, _ in self._rows]) - now
            values = np.nan_to_num(np.array([s for _, s in self._rows]))
            self._plot.data = (when, *values.T)
        if now - self._pictured >= _PICTURES:
            self._pictured = now
            self._show_cameras(view)

    def close(self) -> None:
        """Take it off the page."""
        with self._bench.drawing:
            self._folder.remove()

    def _group(self, name: str, keys: Mapping[str, str]) -> None:
        """Buttons in a row."""
        group = self._bench.server.gui.add_button_group(name, tuple(keys))
        group.on_click(lambda _: self.press(keys[group.value]))

    def _show_cameras(self, view: CaptureView) -> None:
        for camera in view.cameras:
            image, told = small_picture(camera), camera_words(camera)
            if camera.name not in self._cameras:
                with self._pictures:
                    words = self._bench.server.gui.add_markdown(told)
                    shown = self._bench.server.gui.add_image(image, format="jpeg")
                self._cameras[camera.name] = (words, shown)
                continue
            words, shown = self._cameras[camera.name]
            words.content, shown.image = told, image
