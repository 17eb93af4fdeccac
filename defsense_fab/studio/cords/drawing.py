"""The part of the panel with which cords are drawn by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane
from ...core.errors import DefsenseError
from ...core.mesh import Surface
from ...optimize.prediction.draw_cord import drawn_curve
from ..workbench.workbench import Workbench
from .planes import moved, planes
from .sketch import Sketch

#: Called with what was drawn.
Drawn = Callable[[Plane, Hermite], None]


class Drawing:
    """A plane is chosen and looked straight at; each stroke on it becomes a cord."""

    def __init__(self, bench: Workbench, drawn: Drawn) -> None:
        self._bench, self._drawn = bench, drawn
        self._sketch: Sketch | None = None

    def add_panel(self) -> None:
        """Its buttons, in the folder that is open."""
        gui = self._bench.server.gui
        self._plane = gui.add_dropdown(
            "Plane", ("none",), hint="That the cord lies in: the body is cut along it"
        )
        self._plane.on_update(lambda event: self._moved(event, new=True))
        self._offset = gui.add_slider(
            "Offset, mm", -1.0, 1.0, 0.5, 0.0, hint="Along the plane's normal"
        )
        self._offset.on_update(lambda event: self._moved(event, new=False))
        self._button = gui.add_button(
            "Draw by hand", hint="Look straight at the plane, and draw with the left button"
        )
        self._button.on_click(lambda event: self._toggled(event.client))

    def offer(self) -> None:
        """The planes that there are now."""
        surface = self._bench.surface
        if surface is None:
            return
        names = tuple(planes(surface, self._bench.project.device.sensors))
        if tuple(self._plane.options) != names:
            kept = self._plane.value
            self._plane.options = names
            self._plane.value = kept if kept in names else names[0]
        self._bound(surface)

    def plane(self) -> Plane | None:
        """That is chosen, at its offset; None while there is no body."""
        surface = self._bench.surface
        if surface is None:
            return None
        known = planes(surface, self._bench.project.device.sensors)
        found = known.get(self._plane.value)
        return None if found is None else moved(found, float(self._offset.value))

    def close(self) -> None:
        """Put the paper away."""
        if self._sketch is not None:
            self._sketch.close()
            self._sketch = None
        self._button.label = "Draw by hand"

    def _bound(self, surface: Surface) -> None:
        """The offset no further than the body."""
        known = planes(surface, self._bench.project.device.sensors)
        plane = known.get(self._plane.value)
        if plane is None:
            return
        heights = (surface.vertices - plane.origin) @ plane.normal
        low, high = float(np.floor(heights.min())), float(np.ceil(heights.max()))
        if (self._offset.min, self._offset.max) != (low, high):
            self._offset.value = 0.0
            self._offset.min, self._offset.max = low, high

    def _moved(self, event: Any, new: bool) -> None:
        surface = self._bench.surface
        if event.client is None or surface is None:  # set by the page itself
            return
        with self._bench.drawing:
            if new:
                self._offset.value = 0.0
                self._bound(surface)
            if self._sketch is not None:
                self._open(surface, event.client)

    def _toggled(self, client: Any) -> None:
        surface = self._bench.surface
        with self._bench.drawing:
            if self._sketch is not None:
                self.close()
            elif surface is None:
                self._bench.say("There is no body yet: simulate the poses first.")
            else:
                self._open(surface, client)

    def _open(self, surface: Surface, client: Any) -> None:
        self.close()
        plane = self.plane()
        if plane is None:
            return
        self._sketch = Sketch(self._bench.server, surface, plane, self._done)
        self._button.label = "End drawing"
        if client is not None:
            self._sketch.look(client)

    def _done(self, plane: Plane, stroke: Float) -> None:
        surface = self._bench.surface
        if surface is None:
            return
        try:
            self._drawn(plane, drawn_curve(surface, plane, stroke))
        except DefsenseError as error:
            self._bench.fail(error)
