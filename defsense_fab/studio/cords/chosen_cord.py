"""The part of the panel about the cord that is chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...core.device.device import Sensor
from ..edits.cords import (
    delete_point,
    insert_point,
    mirror_cord,
    remove_cord,
    rename_cord,
    set_freedoms,
    smooth,
)
from ..edits.edit import Edit
from ..edits.edit import free_name
from ..workbench.workbench import Workbench
from .cord_scene import PARTS, Part

_NONE = "none"
_FREE: dict[str, tuple[str, ...]] = {
    "nothing (locked)": (),
    "its path": ("path",),
    "its plane": ("plane",),
    "path and plane": ("path", "plane"),
}
_MIRRORS = ("left and right", "front and back", "top and bottom")


class ChosenCord:
    """One cord at a time has handles, for all who look."""

    def __init__(self, bench: Workbench, redraw: Callable[[], None]) -> None:
        self._bench, self._redraw = bench, redraw
        self.name: str | None = None
        self.touched: int | None = None  # the control point that was dragged last

    def add_panel(self) -> None:
        """Its buttons, in the folder that is open."""
        gui, button = self._bench.server.gui, self._bench.button
        self._list = gui.add_dropdown("Cord", (_NONE,), hint="It has handles")
        self._list.on_update(lambda event: self._listed(event))
        self._name = gui.add_text("Name", "", hint="As on the parts and in the guide")
        self._name.on_update(lambda event: self._renamed(event))
        self._part = gui.add_dropdown("Handles on", PARTS, hint="What the handles move")
        self._part.on_update(lambda event: self._redraw() if event.client else None)
        self._snap = gui.add_checkbox("Snap", True, hint="To skin, middle, other cords' points")
        self._again = gui.add_checkbox(
            "Strokes redraw it", False, hint="A line drawn in its plane takes the place of its path"
        )
        self._free = gui.add_dropdown(
            "Optimiser moves", tuple(_FREE), hint="Of this cord; locked ones stay as drawn"
        )
        self._free.on_update(lambda event: self._freed(event))
        button("Add a point", "In its longest span", lambda: self._edit(self._longer))
        button("Delete the point", "That was dragged last", self._delete_point)
        button("Smooth", "Tangents follow from the points", lambda: self._edit(_smoothed))
        self._side = gui.add_dropdown("Mirror", _MIRRORS, hint="Through the body's middle")
        button("Mirrored copy", "Beyond the body's middle", lambda: self._edit(self._mirrored))
        button("Delete the cord", "Undo brings it back", self._delete)

    @property
    def part(self) -> Part:
        """What its handles move."""
        return next(part for part in PARTS if part == self._part.value)

    @property
    def snaps(self) -> bool:
        """Whether points that are dragged snap."""
        return bool(self._snap.value)

    @property
    def redraws(self) -> bool:
        """Whether a stroke takes the place of its path."""
        return bool(self._again.value)

    def sensor(self, sensors: Sequence[Sensor]) -> Sensor | None:
        """The cord among these."""
        return next((s for s in sensors if s.name == self.name), None)

    def choose(self, name: str | None) -> None:
        """Put handles on another."""
        self.name, self.touched = name, None
        self._redraw()

    def show(self, sensors: Sequence[Sensor]) -> None:
        """The panel as the device is now."""
        chosen = self.sensor(sensors)
        if chosen is None:
            self.name = None
        options = (_NONE, *(s.name for s in sensors))
        if tuple(self._list.options) != options:
            self._list.options = options
        self._list.value = self.name or _NONE
        self._name.value = self.name or ""
        for control in (self._name, self._free):
            control.disabled = chosen is None
        if chosen is not None:
            told = next(k for k, free in _FREE.items() if set(free) == set(chosen.free))
            self._free.value = told

    def _listed(self, event: Any) -> None:
        if event.client is not None:  # else set by the page itself
            self.choose(None if self._list.value == _NONE else self._list.value)

    def _renamed(self, event: Any) -> None:
        name = self._name.value.strip()
        if event.client is None or self.name is None or name in ("", self.name):
            return
        before, self.name = self.name, name
        if not self._bench.apply(rename_cord(before, name)):
            self.name = before
            self._redraw()

    def _freed(self, event: Any) -> None:
        if event.client is not None and self.name is not None:
            self._bench.apply(set_freedoms(self.name, _FREE[self._free.value]))

    def _edit(self, edit: Callable[[Sensor], Edit]) -> None:
        chosen = self.sensor(self._bench.project.device.sensors)
        if chosen is None:
            self._bench.show_message("Choose a cord first.")
            return
        self._bench.apply(edit(chosen))

    def _delete(self) -> None:
        name = self.name
        if name is None:
            self._bench.show_message("Choose a cord first.")
            return
        self.name = None
        self._bench.apply(remove_cord(name))

    def _longer(self, cord: Sensor) -> Edit:
        spans = np.linalg.norm(np.diff(cord.curve.points, axis=0), axis=1)
        k = int(spans.argmax())
        self.touched = None
        return insert_point(cord.name, k + 1, cord.curve.sample(2)[2 * k + 1])

    def _delete_point(self) -> None:
        at, self.touched = self.touched, None
        if at is None:
            self._bench.show_message("Drag a point first: the one that was dragged last is deleted.")
        else:
            self._edit(lambda cord: delete_point(cord.name, at))

    def _mirrored(self, cord: Sensor) -> Edit:
        surface = self._bench.surface
        names = [s.name for s in self._bench.project.device.sensors]
        v = np.zeros((1, 3)) if surface is None else surface.vertices
        middle = (v.min(axis=0) + v.max(axis=0)) / 2
        normal = np.eye(3)[(1, 0, 2)[_MIRRORS.index(self._side.value)]]
        name = free_name(f"{cord.name}-mirrored", names)
        return mirror_cord(cord.name, name, middle, normal)


def _smoothed(cord: Sensor) -> Edit:
    return smooth(cord.name)
