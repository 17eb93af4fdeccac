"""The view as an output: every device's newest frame, on a page of its own or as a part of one."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..frames.live_frame import LiveFrame, Quality
from .live_scene import LINES, LiveScene, ViewedDevice
from .local_page import end_page, local_page

# A place for a view on a page that shows other things, too.


@dataclass(frozen=True)
class PagePlace:
    """A viser `server`, and the `folder` of its panel in which a view has one of its own."""

    server: Any
    folder: Any


# Beside the device: how far it is to be believed, controls, signals, how late all of it is.

_SECONDS = 15.0  # of signals that are drawn
_EVERY = 0.2  # s between two drawings of them
_TOLD = 0.5  # s between two looks at notes, which come while no frame does, too
_RECORD, _STOP = "Record the animation", "Stop, and write it"
_SAID = {
    Quality.TRUSTED: "**trusted**",
    Quality.UNTRAINED: "**untrained**: the readings lie outside of the training",
    Quality.FALLBACK: "**fallback**: decoded without {}",
    Quality.LOST: "**lost**: the last good shape stands",
}


@dataclass
class PanelActions:
    """What the panel's buttons do, and what it asks for. `record` starts (True) and stops an
    animation, and says in a sentence what came of it, without it there is no button; `recording` is
    whether one is being recorded. `notes` on the whole run, in place of the frame's, and `latency`
    in a sentence may be set once there is something to tell them."""

    rest: Callable[[], None] | None = None
    record: Callable[[bool], str] | None = None
    recording: Callable[[], bool] = lambda: False
    notes: Callable[[], Sequence[str]] | None = None
    latency: Callable[[], str] | None = None


class LivePanel:
    """In a viser server's panel; `close` it before the server."""

    def __init__(self, server: Any, device: ViewedDevice, actions: PanelActions) -> None:
        import viser.uplot as uplot

        gui = server.gui
        self._device, self._actions, self._drawn = device, actions, 0.0
        self._said = gui.add_markdown(f"### {device.name}\nwaiting for samples")
        self._controls: dict[str, Any] = {}
        self._gui = gui
        self._folder = gui.add_folder("Controls")
        self._rows: deque[tuple[float, Any]] = deque()
        with gui.add_folder("Signals (R - R0)/R0, last 15 s"):
            empty = (np.zeros(1), *(np.zeros(1) for _ in device.channels))
            series = (
                uplot.Series(label="s"),
                *(
                    uplot.Series(label=n, stroke=LINES[k % len(LINES)], width=2)
                    for k, n in enumerate(device.channels)
                ),
            )
            self._plot = gui.add_uplot(
                empty, series, aspect=1.6, scales={"x": uplot.Scale(time=False, auto=True)}
            )
        self._notes = gui.add_markdown("")
        self._record: Any = None
        self._add_buttons()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._go_on, name="panel", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()

    def show(self, frame: LiveFrame) -> None:
        """One frame; it is drawn some times a second."""
        self._rows.append((frame.time, frame.signals))
        while frame.time - self._rows[0][0] > _SECONDS:
            self._rows.popleft()
        now = time.monotonic()
        if now - self._drawn < _EVERY:
            return
        self._drawn = now
        said = _SAID[frame.quality].format(frame.lost)
        radius = float(np.nanmean(frame.radius)) if np.isfinite(frame.radius).any() else None
        lines = [f"### {frame.device}", said]
        if radius is not None:
            lines.append(f"markers within ± {radius:.1f} mm (90 %)")
        if frame.off is not None:
            lines.append(f"cameras (black): {frame.off:.1f} mm off (RMS)")
        if self._actions.latency is not None:
            lines.append(self._actions.latency())
        self._said.content = "\n\n".join(lines)
        if self._actions.notes is None:
            self._tell(frame.notes)
        self._show_controls(frame)
        when = np.array([t for t, _ in self._rows])
        values = np.array([s for _, s in self._rows]).reshape(len(when), -1)
        step = max(len(when) // 400, 1)
        self._plot.data = (
            when[::step] - when[-1],
            *(np.nan_to_num(v) for v in values[::step].T),
        )

    def _show_controls(self, frame: LiveFrame) -> None:
        for name, value in frame.controls.items():
            if name not in self._controls:
                with self._folder:
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
                "At rest now", hint="Take the readings of this moment for the device's rest"
            )
            button.on_click(lambda _, rest=rest: rest())
        if record is not None:
            self._record_button(record)

    def _record_button(self, record: Callable[[bool], str]) -> None:
        button = self._record = self._gui.add_button(_RECORD, color="red")
        told = self._gui.add_markdown("")
        self._label()

        def clicked(_: Any) -> None:
            button.disabled = True  # while a file is written, a second click would begin anew
            try:
                told.content = record(not self._actions.recording())
                self._label()
            finally:
                button.disabled = False

        button.on_click(clicked)

    def _label(self) -> None:
        """What the button would do now: recordings begin and end without it, too."""
        said = _STOP if self._actions.recording() else _RECORD
        if self._record is not None and self._record.label != said:
            self._record.label = said

    def _tell(self, notes: Sequence[str]) -> None:
        content = "\n".join(f"- {note}" for note in notes)
        if self._notes.content != content:
            self._notes.content = content

    def _go_on(self) -> None:
        while not self._over.wait(_TOLD):
            if self._actions.notes is not None:
                self._tell(self._actions.notes())
            self._label()


PORT = 8080


class LiveView:
    """An `Output` on a page at http://127.0.0.1:`place`, or in a place of a page that is there,
    which is left as it was. Raises OutputError for a port that is taken, and where viser is not
    installed."""

    name, trouble = "view", None

    def __init__(
        self, device: ViewedDevice, actions: PanelActions | None = None,
        place: int | PagePlace = PORT,
    ) -> None:  # fmt: skip
        self._folder: Any = None
        if isinstance(place, PagePlace):
            self.server: Any = place.server
            with place.folder:
                self._folder = self.server.gui.add_folder(f"{device.name} live")
        else:
            self.server = local_page(place, f"{device.name} live")
        self.port = int(self.server.get_port())
        with self._folder or nullcontext():
            self.panel = LivePanel(self.server, device, actions or PanelActions())
        self.scene = (
            LiveScene(self.server, device)
            if self._folder is None
            else LiveScene(self.server, device, "/live", look=False)
        )

    @property
    def about(self) -> str:
        return f"view: {self.url}"

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def send(self, frame: LiveFrame) -> None:
        with self.server.atomic():
            self.scene.show(frame)
            self.panel.show(frame)

    def close(self) -> None:
        self.panel.close()
        if self._folder is None:
            end_page(self.server)
            return
        self.scene.close()
        self._folder.remove()
