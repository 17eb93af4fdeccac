"""The screen of a guided recording: instructions, coverage of the poses, signals and cameras."""

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

PICTURE_WIDTH = 320  # pixels
_SIGNAL_DURATION_S = 20.0  # of the plot
_TEXT_INTERVAL_S, _PICTURE_INTERVAL_S = 0.25, 0.5  # between updates
#: Color-blind people can distinguish tags that several cameras see from those that one sees.
_SHARED_TAG_COLOR, _SINGLE_TAG_COLOR = (0, 158, 115), (230, 159, 0)
_COVERED_COLOR, _UNCOVERED_COLOR = "#1f77b4", "rgba(128,128,128,.25)"
_PHASE_TEXTS = {
    "ready": "Press *Start* when you are ready.",
    "showing": "Now.",
    "done": "",
}


class KeyButtons:
    """Buttons in place of the keys of a guided routine; they may be pressed on any thread."""

    def __init__(self) -> None:
        self._keys = queue.SimpleQueue[str]()

    def press(self, key: str) -> None:
        """Press a key, such as "enter" or "q"."""
        self._keys.put(key)

    def key(self, timeout: float) -> str | None:
        """Return the next key, or None if none is pressed within `timeout` seconds."""
        try:
            return self._keys.get(timeout=timeout)
        except queue.Empty:
            return None


class RecordingScreen(KeyButtons):
    """Show a recording in a folder of the panel; implements `CaptureScreen`.

    Args:
        bench: The workbench.
        folder: Folder of the panel.
        channels: Names of the channels.

    Attributes:
        view: The state that is shown, or None before the first one.
        pictures: The shown pictures (h, PICTURE_WIDTH, 3) by the names of the cameras.
        text_interval_s: Time between updates of the texts and the plot, s.
        picture_interval_s: Time between updates of the pictures, s.
    """

    def __init__(self, bench: Workbench, folder: Any, channels: tuple[str, ...]) -> None:
        super().__init__()
        gui = bench.server.gui
        self._bench = bench
        self.view: CaptureView | None = None
        self.pictures: dict[str, NDArray[np.uint8]] = {}
        self.text_interval_s, self.picture_interval_s = _TEXT_INTERVAL_S, _PICTURE_INTERVAL_S
        self._signals: deque[tuple[float, Float]] = deque()
        self._drawn_at = self._pictures_drawn_at = 0.0
        self._camera_handles: dict[str, tuple[Any, Any]] = {}
        with folder:
            self._folder = gui.add_folder("Recording")
        with self._folder:
            self._text = gui.add_markdown("Preparing ...")
            self._add_keys("Step", {"Start": "enter", "Repeat": "r", "Back": "b", "Skip": "s"})
            self._add_keys("Recording", {"Stop": "q"})
            self._pictures_folder = gui.add_folder(None)
            self._bars = gui.add_html("")
            self._plot = self._add_plot(channels) if channels else None

    def show(self, view: CaptureView) -> None:
        """Show the state of the recording, at most once in each interval."""
        now = time.monotonic()
        self._signals.append((now, np.asarray(view.signals, float)))
        while now - self._signals[0][0] > _SIGNAL_DURATION_S:
            self._signals.popleft()
        if now - self._drawn_at < self.text_interval_s and view.phase != "done":
            return
        self._drawn_at = now
        self.view = view
        self._text.content = step_text(view)
        bars = coverage_bars(view.reached)
        if self._bars.content != bars:
            self._bars.content = bars
        if self._plot is not None:
            times = np.array([t for t, _ in self._signals]) - now
            values = np.nan_to_num(np.array([s for _, s in self._signals]))
            self._plot.data = (times, *values.T)
        if now - self._pictures_drawn_at >= self.picture_interval_s:
            self._pictures_drawn_at = now
            self._show_cameras(view)

    def close(self) -> None:
        """Remove the screen from the page."""
        with self._bench.drawing_lock:
            self._folder.remove()

    def _add_plot(self, channels: tuple[str, ...]) -> Any:
        from viser import uplot

        lines = (
            uplot.Series(label=name, stroke=LINES[k % len(LINES)], width=2)
            for k, name in enumerate(channels)
        )
        return self._bench.server.gui.add_uplot(
            (np.zeros(1), *(np.zeros(1) for _ in channels)),
            (uplot.Series(label="s"), *lines),
            aspect=1.6,
            title="(R - R0)/R0, last 20 s",
            scales={"x": uplot.Scale(time=False, auto=True)},
        )

    def _add_keys(self, label: str, keys: Mapping[str, str]) -> None:
        """Add a row of buttons that press keys."""
        group = self._bench.server.gui.add_button_group(label, tuple(keys))
        group.on_click(lambda _: self.press(keys[group.value]))

    def _show_cameras(self, view: CaptureView) -> None:
        gui = self._bench.server.gui
        for camera in view.cameras:
            picture, text = small_picture(camera), camera_text(camera)
            self.pictures[camera.name] = picture
            if camera.name not in self._camera_handles:
                with self._pictures_folder:
                    handles = (gui.add_markdown(text), gui.add_image(picture, format="jpeg"))
                self._camera_handles[camera.name] = handles
                continue
            text_handle, image_handle = self._camera_handles[camera.name]
            text_handle.content, image_handle.image = text, picture


def step_text(view: CaptureView) -> str:
    """Return the step, what to do, what is recorded and the warnings in markdown."""
    name, duration = view.steps[view.step]
    remaining = view.left if view.phase == "showing" else duration
    counts = [f"{view.samples} samples"]
    if view.cameras:
        counts += [
            f"{view.frames} frames",
            f"tags: {view.several} of {view.tags} in several cameras, {view.single} in one camera",
        ]
    if math.isfinite(view.residual):
        counts.append(f"residual {view.residual:.2f} px")
    return "\n\n".join(
        [
            f"#### {view.step + 1} of {len(view.steps)}: {name}, {remaining:.0f} s",
            f"**{view.next}** {_PHASE_TEXTS.get(view.phase, '')}",
            "; ".join(counts),
            *(f"- **{note}**" for note in view.notes),
        ]
    )


def coverage_bars(coverage: Mapping[str, tuple[float, Bool]]) -> str:
    """Return how far each pose was shown as HTML; empty if that is unknown.

    Args:
        coverage: By pose: the largest share of its way from rest, and which parts of the way were
            seen.
    """
    if not coverage:
        return ""
    rows = "".join(_pose_bar(name, largest, parts) for name, (largest, parts) in coverage.items())
    return (
        f'<div style="font-size:11px;line-height:1.4">{rows}<div style="opacity:.7">'
        "Recorded parts of the way from rest to each pose</div></div>"
    )


def _pose_bar(name: str, largest: float, parts: Bool) -> str:
    boxes = "".join(
        '<span style="flex:1;height:9px;margin-right:2px;'
        f'background:{_COVERED_COLOR if is_covered else _UNCOVERED_COLOR}"></span>'
        for is_covered in parts
    )
    return (
        '<div style="display:flex;align-items:center;gap:4px">'
        f'<span style="width:30%;overflow:hidden;text-overflow:ellipsis">{html.escape(name)}</span>'
        f'<span style="flex:1;display:flex">{boxes}</span>'
        f'<span style="width:14%;text-align:right">{100 * largest:.0f} %</span></div>'
    )


def small_picture(view: CameraView) -> NDArray[np.uint8]:
    """Return a camera's picture (h, PICTURE_WIDTH, 3) RGB with the outlines of its tags.

    It is gray if there is no recent picture.
    """
    if view.image is None:
        return np.full((PICTURE_WIDTH * 9 // 16, PICTURE_WIDTH, 3), 128, np.uint8)
    h, w = view.image.shape[:2]
    height = max(2, round(PICTURE_WIDTH * h / w))
    small = cv2.resize(view.image, (PICTURE_WIDTH, height), interpolation=cv2.INTER_AREA)
    if small.ndim == 2:
        small = np.repeat(small[:, :, None], 3, axis=2)
    small = np.ascontiguousarray(small[:, :, ::-1])
    scale = np.array([PICTURE_WIDTH / w, height / h])
    for outline, is_shared in zip(view.outlines, view.shared, strict=True):
        corners = np.round((np.asarray(outline) + 0.5) * scale - 0.5).astype(np.int32)
        color = _SHARED_TAG_COLOR if is_shared else _SINGLE_TAG_COLOR
        cv2.polylines(small, [corners], True, color, 2)
    return np.asarray(small, np.uint8)


def camera_text(view: CameraView) -> str:
    """Return the name of a camera, its number of tags and its frame rate."""
    if view.image is None:
        return f"{view.name}: no picture"
    return f"{view.name}: {len(view.ids)} tags, {view.rate:.0f} frames/s"
