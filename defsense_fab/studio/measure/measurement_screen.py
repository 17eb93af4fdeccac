"""The screen of a guided measurement of a specimen: instructions, readings and a plot."""

from __future__ import annotations

import html
import time
from typing import Any

import numpy as np

from ...calibration.guided_measurement import MeasurementView
from ...calibration.session import CHANNELS
from ..workbench.workbench import Workbench
from .recording_screen import KeyButtons

_UPDATE_INTERVAL_S = 0.25
_KEYS = {"Measure": "enter", "Repeat": "r", "Take now": "t", "Back": "b", "Skip": "s", "Stop": "q"}
#: Which side of the specimen is on the jig, and which cord is then on top, by face.
_SIDES = {"a": ("bottom", "top"), "b": ("top", "bottom")}
#: Colors of the cords by their place; color-blind people can distinguish them.
_PLACE_COLORS = {"top": "#e69f00", "neutral": "#009e73", "bottom": "#0072b2"}
_PLOT_WIDTH, _PLOT_HEIGHT = 260, 150  # pixels
_PLOT_FILL = 0.95  # share of the plot that the largest values use
_MIN_PLOT_RANGE = 1e-3  # of strains and of changes


class MeasurementScreen(KeyButtons):
    """Show a measurement in a folder of the panel; its buttons press keys.

    Args:
        bench: The workbench.
        folder: Folder of the panel.

    Attributes:
        view: The state that is shown, or None before the first one.
    """

    def __init__(self, bench: Workbench, folder: Any) -> None:
        super().__init__()
        gui = bench.server.gui
        self._bench = bench
        self._drawn_at = 0.0
        self.view: MeasurementView | None = None
        with folder:
            self._folder = gui.add_folder("Measurement")
        with self._folder:
            self._text = gui.add_markdown("Preparing ...")
            group = gui.add_button_group("Step", tuple(_KEYS))
            group.on_click(lambda _: self.press(_KEYS[group.value]))
            self._plot = gui.add_html("")

    def show(self, view: MeasurementView) -> None:
        """Show the state of the measurement, at most four times a second."""
        now = time.monotonic()
        if now - self._drawn_at < _UPDATE_INTERVAL_S and view.phase != "done":
            return
        self._drawn_at = now
        self.view = view
        self._text.content = jig_text(view)
        plot = readings_plot(view)
        if self._plot.content != plot:
            self._plot.content = plot

    def close(self) -> None:
        """Remove the screen from the page."""
        with self._bench.drawing_lock:
            self._folder.remove()


def jig_text(view: MeasurementView) -> str:
    """Return the instructions, the settling, the readings and the warnings in markdown."""
    lines = [f"#### {view.done} of {view.total} readings"]
    if view.phase == "unplugged":
        lines.append(
            "**The read-out board is disconnected.** Plug it in again. The step then starts again."
        )
    elif view.step is not None:
        down, up = _SIDES[view.step.face]
        jig = "the flat jig" if view.step.radius is None else f"jig {view.step.jig}"
        lines.append(
            f"Place the specimen on **{jig}**, with its **{down}** side on the jig and the {up}"
            " cord on top. Strap it down."
        )
        if view.phase == "place":
            lines.append("Press *Measure* when it is in place.")
        elif view.phase == "settling":
            change = "" if view.settling is None else f", changes by {view.settling.change:.2%}"
            lines.append(f"Settling: {view.elapsed:.0f} s{change}.")
    readings = [
        f"{name} {ohm:.0f} Ω" if np.isfinite(ohm) else f"{name} -"
        for name, ohm in zip(CHANNELS, view.ohm, strict=True)
    ]
    lines.append(", ".join(readings))
    lines += [f"- **{note}**" for note in view.notes]
    return "\n\n".join(lines)


def readings_plot(view: MeasurementView) -> str:
    """Return the finished readings, (R - R0)/R0 over strain, as HTML; empty before the first."""
    points = [p for p in view.points if np.isfinite([p.strain, p.change]).all()]
    if not points:
        return ""
    max_strain = max(*(abs(p.strain) for p in points), _MIN_PLOT_RANGE)
    max_change = max(*(abs(p.change) for p in points), _MIN_PLOT_RANGE)
    dots = "".join(
        f'<circle cx="{_PLOT_WIDTH / 2 * (1 + _PLOT_FILL * p.strain / max_strain):.1f}"'
        f' cy="{_PLOT_HEIGHT / 2 * (1 - _PLOT_FILL * p.change / max_change):.1f}" r="3"'
        f' fill="{_PLACE_COLORS.get(p.place, "gray")}"/>'
        for p in points
    )
    legend = ", ".join(
        f'<span style="color:{color}">{html.escape(place)}</span>'
        for place, color in _PLACE_COLORS.items()
    )
    axes = f"M0 {_PLOT_HEIGHT / 2}H{_PLOT_WIDTH}M{_PLOT_WIDTH / 2} 0V{_PLOT_HEIGHT}"
    return (
        f'<svg width="{_PLOT_WIDTH}" height="{_PLOT_HEIGHT}"'
        f' style="background:rgba(128,128,128,.12)"><path d="{axes}" stroke="currentColor"'
        f' opacity=".4"/>{dots}</svg><div style="font-size:11px">(R - R0)/R0 (&plusmn;'
        f"{max_change:.0%}) over strain (&plusmn;{max_strain:.1%}): {legend}</div>"
    )
