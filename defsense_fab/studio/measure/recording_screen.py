"""The screen of a guided recording, on the page."""

from __future__ import annotations

import html
import math
import queue
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...capture.sessions.guided_recording import CameraView, CaptureView
from ...core.arrays import Bool, Float
from ...runtime.view.live_scene import LINES
from ..workbench.workbench import Workbench

# Buttons in place of the keys that a guided routine asks for.


class PressedKeys:
    """From any thread to the routine's."""

    def __init__(self) -> None:
        self._keys = queue.SimpleQueue[str]()

    def press(self, key: str) -> None:
        """As on a keyboard: enter, q and so on."""
        self._keys.put(key)

    def key(self, timeout: float) -> str | None:
        """The next one; None where none comes within so many s."""
        try:
            return self._keys.get(timeout=timeout)
        except queue.Empty:
            return None


# What is told while a device is recorded: what to do next, and how much of each pose was seen.

_SEEN, _NOT = "#1f77b4", "rgba(128,128,128,.25)"
_THEN = {
    "ready": "*Begin* when you are ready.",
    "showing": "Now.",
    "done": "",
}


def step_words(view: CaptureView) -> str:
    """Markdown: which step, what to do, what is there, what is wrong."""
    name, seconds = view.steps[view.step]
    left = view.left if view.phase == "showing" else seconds
    lines = [
        f"#### {view.step + 1} of {len(view.steps)}: {name}, {left:.0f} s",
        f"**{view.next}** {_THEN.get(view.phase, '')}",
    ]
    counts = [f"{view.samples} samples"]
    if view.cameras:
        counts.append(f"{view.frames} pictures")
        counts.append(f"tags: {view.several} of {view.tags} by several cameras, {view.single} by"
                      " one")  # fmt: skip
    if math.isfinite(view.residual):
        counts.append(f"residual {view.residual:.2f} px")
    lines.append("; ".join(counts))
    lines += [f"- **{note}**" for note in view.notes]
    return "\n\n".join(lines)


def coverage_bars(reached: Mapping[str, tuple[float, Bool]]) -> str:
    """HTML: of each pose the parts of its way, from rest to its extreme, that were seen; empty
    where that is not known."""
    if not reached:
        return ""
    rows = "".join(_pose(name, most, seen) for name, (most, seen) in reached.items())
    return (
        f'<div style="font-size:11px;line-height:1.4">{rows}<div style="opacity:.7">'
        "of the way from rest to each pose, seen so far</div></div>"
    )


def _pose(name: str, most: float, seen: Bool) -> str:
    parts = "".join(
        f'<span style="flex:1;height:9px;margin-right:2px;background:{_SEEN if part else _NOT}">'
        "</span>"
        for part in seen
    )
    return (
        '<div style="display:flex;align-items:center;gap:4px">'
        f'<span style="width:30%;overflow:hidden;text-overflow:ellipsis">{html.escape(name)}</span>'
        f'<span style="flex:1;display:flex">{parts}</span>'
        f'<span style="width:14%;text-align:right">{100 * most:.0f} %</span></div>'
    )


# What a camera sees, small, with the tags that were found.

WIDTH = 320  # pixels
#: Told apart by all: tags that several cameras see, and those that one does.
_SEVERAL, _ONE = (0, 158, 115), (230, 159, 0)


def small_picture(view: CameraView) -> NDArray[np.uint8]:
    """(h, WIDTH, 3) RGB; grey while there is no picture."""
    if view.image is None:
        return np.full((WIDTH * 9 // 16, WIDTH, 3), 128, np.uint8)
    h, w = view.image.shape[:2]
    tall = max(2, round(WIDTH * h / w))
    small = cv2.resize(view.image, (WIDTH, tall), interpolation=cv2.INTER_AREA)
    if small.ndim == 2:
        small = np.repeat(small[:, :, None], 3, axis=2)
    small = np.ascontiguousarray(small[:, :, ::-1])
    scale = np.array([WIDTH / w, tall / h])
    for quad, shared in zip(view.outlines, view.shared, strict=True):
        at = np.round((np.asarray(quad) + 0.5) * scale - 0.5).astype(np.int32)
        cv2.polylines(small, [at], True, _SEVERAL if shared else _ONE, 2)
    return np.asarray(small, np.uint8)


def camera_words(view: CameraView) -> str:
    """Its name, and what it finds."""
    if view.image is None:
        return f"{view.name}: no picture"
    return f"{view.name}: {len(view.ids)} tags, {view.rate:.0f} pictures/s"


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
        with self._bench.drawing_lock:
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
