"""The screen of a guided measurement of a specimen, on the page."""

from __future__ import annotations

import html
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...calibration.guided_measurement import MeasurementView
from ...calibration.session import CHANNELS
from ..workbench.workbench import Workbench
from .recording_screen import PressedKeys
from .result_texts import notes_list

# What is told while a specimen is measured, and what came of it.

_DOWN = {"a": ("bottom", "top"), "b": ("top", "bottom")}
#: Of cords by their place, told apart by all.
_COLORS = {"top": "#e69f00", "neutral": "#009e73", "bottom": "#0072b2"}
_WIDE, _HIGH = 260, 150  # pixels of the plot


def jig_words(view: MeasurementView) -> str:
    """Markdown: what to lay where, whether it has settled, what is read, what is wrong."""
    lines = [f"#### {view.done} of {view.total} readings"]
    if view.phase == "unplugged":
        lines.append("**The read-out board is gone.** Plug it in again; this step is then measured"
                     " from its beginning.")  # fmt: skip
    elif view.step is not None:
        down, up = _DOWN[view.step.face]
        jig = "the flat jig" if view.step.radius is None else f"jig {view.step.jig}"
        lines.append(
            f"Lay the specimen on **{jig}**, its **{down}** side on the jig, the {up} cord up;"
            " strap it down."
        )
        if view.phase == "place":
            lines.append("*Measure* when it lies.")
        elif view.phase == "settling":
            change = "" if view.settling is None else f", changes by {view.settling.change:.2%}"
            lines.append(f"Settling: {view.elapsed:.0f} s{change}.")
    ohm = [f"{name} {r:.0f} Ω" if np.isfinite(r) else f"{name} -"
           for name, r in zip(CHANNELS, view.ohm, strict=True)]  # fmt: skip
    lines.append(", ".join(ohm))
    lines += [f"- **{note}**" for note in view.notes]
    return "\n\n".join(lines)


def points_plot(view: MeasurementView) -> str:
    """HTML: finished readings, (R - R0)/R0 by strain; empty before the first."""
    good = [p for p in view.points if np.isfinite([p.strain, p.change]).all()]
    if not good:
        return ""
    most = max(*(abs(p.strain) for p in good), 1e-3), max(*(abs(p.change) for p in good), 1e-3)
    dots = "".join(
        f'<circle cx="{_WIDE / 2 * (1 + 0.95 * p.strain / most[0]):.1f}"'
        f' cy="{_HIGH / 2 * (1 - 0.95 * p.change / most[1]):.1f}" r="3"'
        f' fill="{_COLORS.get(p.place, "gray")}"/>'
        for p in good
    )
    legend = ", ".join(f'<span style="color:{c}">{html.escape(n)}</span>'
                       for n, c in _COLORS.items())  # fmt: skip
    return (
        f'<svg width="{_WIDE}" height="{_HIGH}" style="background:rgba(128,128,128,.12)">'
        f'<path d="M0 {_HIGH / 2}H{_WIDE}M{_WIDE / 2} 0V{_HIGH}" stroke="currentColor"'
        f' opacity=".4"/>{dots}</svg><div style="font-size:11px">(R - R0)/R0, &plusmn;'
        f"{most[1]:.0%}, by strain, &plusmn;{most[0]:.1%}: {legend}</div>"
    )


def response_words(result: Mapping[str, Any]) -> str:
    """Of a fit that has just ended."""
    d = result["data"]
    low, high = d["interval"]
    strains = d["strain_range"]
    return "\n\n".join(
        part
        for part in (
            f"**k_res = {d['k_res']:.2f}** (95 %: {low:.2f} to {high:.2f})",
            str(d["reason"]),
            f"Strains {strains[0]:.1%} to {strains[1]:.1%}, {d['readings']} readings of"
            f" {len(d['pieces'])} pieces. All of it: `{result['page']}`",
            notes_list(d["warnings"]),
        )
        if part
    )


_EVERY = 0.25  # s between two drawings
_KEYS = {"Measure": "enter", "Repeat": "r", "Take now": "t", "Back": "b", "Skip": "s", "Stop": "q"}


class MeasurementScreen(PressedKeys):
    """Shows views in the `folder`, and hands over the keys that its buttons `press`."""

    def __init__(self, bench: Workbench, folder: Any) -> None:
        super().__init__()
        gui = bench.server.gui
        self._bench = bench
        self._drawn = 0.0
        with folder:
            self._folder = gui.add_folder("Measurement")
        with self._folder:
            self._said = gui.add_markdown("Preparing ...")
            group = gui.add_button_group("Step", tuple(_KEYS))
            group.on_click(lambda _: self.press(_KEYS[group.value]))
            self._plot = gui.add_html("")

    def show(self, view: MeasurementView) -> None:
        now = time.monotonic()
        if now - self._drawn < _EVERY and view.phase != "done":
            return
        self._drawn = now
        self._said.content = jig_words(view)
        plot = points_plot(view)
        if self._plot.content != plot:
            self._plot.content = plot

    def close(self) -> None:
        """Take it off the page."""
        with self._bench.drawing_lock:
            self._folder.remove()
