"""Show frames on a page in the browser, as an output with a scene and a panel."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..frames.live_frame import LiveFrame, Note, Quality
from .live_scene import LINES, LiveScene, ViewedDevice
from .page_server import close_page, serve_page
from .panel_actions import PanelActions as PanelActions

_PLOT_DURATION_S = 15.0
_PLOT_POINTS = 400
_PANEL_INTERVAL_S = 0.2  # between two updates of the panel
_NOTES_INTERVAL_S = 0.5  # between two updates of notes, which also change without frames
#: Labels of the button for animations.
RECORD_LABEL, STOP_LABEL = "Record animation", "Stop and save"
_QUALITY_TEXTS = {
    Quality.TRUSTED: "**trusted**",
    Quality.UNTRAINED: "**untrained**: the readings are outside the range of the training",
    Quality.FALLBACK: "**fallback**: decoded without {}",
    Quality.LOST: "**lost**: the last good shape is shown",
}


@dataclass(frozen=True)
class PagePlace:
    """A place for a view on a page that also shows other things.

    Attributes:
        server: The viser server.
        folder: Folder of its panel that the view's own folder is added to.
    """

    server: Any
    folder: Any


class LivePanel:
    """A panel with quality, controls, signals, latency and buttons.

    Close it before the server.

    Args:
        server: The viser server.
        device: The device.
        actions: What the buttons do.
    """

    def __init__(self, server: Any, device: ViewedDevice, actions: PanelActions) -> None:
        gui = server.gui
        self._actions, self._updated_at = actions, 0.0
        self._summary = gui.add_markdown(f"### {device.name}\nwaiting for samples")
        self._controls: dict[str, Any] = {}
        self._gui = gui
        self._controls_folder = gui.add_folder("Controls")
        self._rows: deque[tuple[float, Any]] = deque()
        self._plot = self._add_plot(device)
        self._notes = gui.add_markdown("")
        self._record_button: Any = None
        self._add_buttons()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._update_notes, name="panel", daemon=True)
        self._thread.start()

    @property
    def summary(self) -> str:
        """Markdown of the quality and the latency."""
        return str(self._summary.content)

    @property
    def notes(self) -> str:
        """Markdown of the notes."""
        return str(self._notes.content)

    def close(self) -> None:
        """End the thread that updates the notes."""
        self._stop.set()
        self._thread.join()

    def show(self, frame: LiveFrame) -> None:
        """Show a frame; the panel is updated a few times a second."""
        self._rows.append((frame.time, frame.signals))
        while frame.time - self._rows[0][0] > _PLOT_DURATION_S:
            self._rows.popleft()
        now = time.monotonic()
        if now - self._updated_at < _PANEL_INTERVAL_S:
            return
        self._updated_at = now
        self._summary.content = "\n\n".join(self._summary_lines(frame))
        if self._actions.notes is None:
            self._show_notes(frame.notes)
        self._show_controls(frame)
        times = np.array([t for t, _ in self._rows])
        values = np.array([s for _, s in self._rows]).reshape(len(times), -1)
        step = max(len(times) // _PLOT_POINTS, 1)
        self._plot.data = (
            times[::step] - times[-1],
            *(np.nan_to_num(v) for v in values[::step].T),
        )

    def _summary_lines(self, frame: LiveFrame) -> list[str]:
        lines = [
            f"### {frame.device}",
            _QUALITY_TEXTS[frame.quality].format(frame.lost_channel),
        ]
        if np.isfinite(frame.radius).any():
            lines.append(f"markers within ± {float(np.nanmean(frame.radius)):.1f} mm (90 %)")
        if frame.tracking_error is not None:
            lines.append(f"cameras (black): {frame.tracking_error:.1f} mm apart (RMS)")
        if self._actions.latency is not None:
            lines.append(self._actions.latency())
        return lines

    def _add_plot(self, device: ViewedDevice) -> Any:
        import viser.uplot as uplot

        with self._gui.add_folder("Signals (R - R0)/R0, last 15 s"):
            empty = (np.zeros(1), *(np.zeros(1) for _ in device.channels))
            series = (
                uplot.Series(label="s"),
                *(
                    uplot.Series(label=n, stroke=LINES[k % len(LINES)], width=2)
                    for k, n in enumerate(device.channels)
                ),
            )
            scales = {"x": uplot.Scale(time=False, auto=True)}
            return self._gui.add_uplot(empty, series, aspect=1.6, scales=scales)

    def _show_controls(self, frame: LiveFrame) -> None:
        for name, value in frame.controls.items():
            if name not in self._controls:
                with self._controls_folder:
                    label = self._gui.add_markdown(name)
                    bar = self._gui.add_progress_bar(0.0)
                self._controls[name] = (label, bar)
            label, bar = self._controls[name]
            label.content = f"{name}: **{value:.2f}**"
            bar.value = float(np.clip(100 * value, 0, 100))

    def _add_buttons(self) -> None:
        rest, record = self._actions.rest, self._actions.record
        if rest is not None:
            button = self._gui.add_button(
                "At rest now", hint="Take the present readings as those of the device at rest"
            )
            button.on_click(lambda _, rest=rest: rest())
        if record is not None:
            self._add_record_button(record)

    def _add_record_button(self, record: Callable[[bool], str]) -> None:
        button = self._record_button = self._gui.add_button(RECORD_LABEL, color="red")
        message = self._gui.add_markdown("")
        self._update_label()

        def clicked(_: Any) -> None:
            button.disabled = True  # a second click, while a file is written, would start again
            try:
                message.content = record(not self._actions.is_recording())
                self._update_label()
            finally:
                button.disabled = False

        button.on_click(clicked)

    def _update_label(self) -> None:
        """Show what the button would do now; recordings also start and end without it."""
        label = STOP_LABEL if self._actions.is_recording() else RECORD_LABEL
        if self._record_button is not None and self._record_button.label != label:
            self._record_button.label = label

    def _show_notes(self, notes: Sequence[Note | str]) -> None:
        content = "\n".join(f"- {note}" for note in notes)
        if self._notes.content != content:
            self._notes.content = content

    def _update_notes(self) -> None:
        while not self._stop.wait(_NOTES_INTERVAL_S):
            if self._actions.notes is not None:
                self._show_notes(self._actions.notes())
            self._update_label()


class LiveView:
    """An `Output` on a page at http://127.0.0.1, or in a place of an existing page.

    Closing it leaves an existing page as it was.

    Args:
        device: The device.
        actions: What the panel's buttons do.
        place: Port of the page, or the place.

    Attributes:
        server: The viser server.
        port: Port of the page.
        panel: The panel.
        scene: The scene.

    Raises:
        OutputError: The port is in use, or viser is not installed.
    """

    name, trouble = "view", None

    def __init__(
        self,
        device: ViewedDevice,
        actions: PanelActions,
        place: int | PagePlace,
    ) -> None:
        self._folder: Any = None
        if isinstance(place, PagePlace):
            self.server: Any = place.server
            with place.folder:
                self._folder = self.server.gui.add_folder(f"{device.name} live")
        else:
            self.server = serve_page(place, f"{device.name} live")
        self.port = int(self.server.get_port())
        with self._folder or nullcontext():
            self.panel = LivePanel(self.server, device, actions)
        self.scene = (
            LiveScene(self.server, device)
            if self._folder is None
            else LiveScene(self.server, device, "/live", look=False)
        )

    @property
    def about(self) -> str:
        """Description with the address of the page."""
        return f"view: {self.url}"

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}"

    def send(self, frame: LiveFrame) -> None:
        """Show a frame."""
        with self.server.atomic():
            self.scene.show(frame)
            self.panel.show(frame)

    def close(self) -> None:
        """Close the page, or remove the view from it."""
        self.panel.close()
        if self._folder is None:
            close_page(self.server)
            return
        self.scene.close()
        self._folder.remove()
