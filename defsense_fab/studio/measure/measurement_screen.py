"""The screen of a guided measurement of a specimen, on the page."""

from __future__ import annotations

import time
from typing import Any

from ...calibration.guided_measurement import MeasurementView
from ..workbench.workbench import Workbench
from .measurement_words import jig_words, points_plot
from .pressed_keys import PressedKeys

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
        with self._bench.drawing:
            self._folder.remove()
