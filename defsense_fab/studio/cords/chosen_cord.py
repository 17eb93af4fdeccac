"""The panel of the chosen cord."""

from __future__ import annotations

from collections.abc import Callable, Sequence

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
from ..edits.edit import Edit, free_name
from ..workbench.controls import NONE, add_field, on_user
from ..workbench.workbench import Workbench
from .cord_scene import HANDLE_KINDS, HandleKind

_FREEDOMS: dict[str, tuple[str, ...]] = {
    "nothing (locked)": (),
    "its path": ("path",),
    "its plane": ("plane",),
    "path and plane": ("path", "plane"),
    "path and ends, in space": ("path", "ends"),
}
_MIRROR_AXES = {"left and right": 1, "front and back": 0, "top and bottom": 2}


class ChosenCord:
    """Choose a cord and edit it; all browsers see the same cord with handles.

    Args:
        bench: The workbench.
        redraw: Called after another cord or another kind of handle was chosen.

    Attributes:
        name: Name of the chosen cord, or None.
        last_point: Index of the control point that was dragged last, or None.
    """

    def __init__(self, bench: Workbench, redraw: Callable[[], None]) -> None:
        self._bench, self._redraw = bench, redraw
        self.name: str | None = None
        self.last_point: int | None = None

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, button = self._bench.server.gui, self._bench.button
        self._list = gui.add_dropdown("Cord", (NONE,), hint="Choose the cord that has handles")
        on_user(self._list, lambda name: self.choose(None if name == NONE else name))
        self._name = add_field(gui, "sensors.name", "")
        on_user(self._name, self._rename)
        self._handles = gui.add_dropdown(
            "Handles on", HANDLE_KINDS, hint="Choose what the handles move"
        )
        on_user(self._handles, lambda _: self._redraw())
        self._snap = gui.add_checkbox(
            "Snap points", True, hint="Snap to the surface, the middle and other cords' points"
        )
        self._replace = gui.add_checkbox(
            "Strokes replace its path", False, hint="Redraw the cord by a stroke in its plane"
        )
        self._freedom = gui.add_dropdown(
            "Optimizer moves",
            tuple(_FREEDOMS),
            hint="Choose what the optimizer may change. A locked cord stays as drawn",
        )
        on_user(self._freedom, self._set_freedom)
        button("Add a point", "Add a control point in the longest span", self.add_point)
        button("Delete the point", "Delete the point that was dragged last", self.delete_point)
        button("Smooth", "Compute the tangents from the points", self.smooth)
        self._mirror = gui.add_dropdown(
            "Mirror", tuple(_MIRROR_AXES), hint="Choose the sides of the body to swap"
        )
        button("Add a mirrored copy", "Mirror the cord at the body's middle", self.add_mirrored)
        button("Delete the cord", "Delete it. Undo restores it", self.delete)

    @property
    def handle_kind(self) -> HandleKind:
        """What the handles move."""
        return next(kind for kind in HANDLE_KINDS if kind == self._handles.value)

    @property
    def is_snapping(self) -> bool:
        """Whether dragged points snap."""
        return bool(self._snap.value)

    @property
    def is_replaced_by_strokes(self) -> bool:
        """Whether a stroke in the cord's plane replaces its path."""
        return bool(self._replace.value)

    @is_replaced_by_strokes.setter
    def is_replaced_by_strokes(self, value: bool) -> None:
        self._replace.value = value

    def find(self, sensors: Sequence[Sensor]) -> Sensor | None:
        """Return the chosen cord among these."""
        return next((s for s in sensors if s.name == self.name), None)

    def choose(self, name: str | None) -> None:
        """Put the handles on another cord, or on none."""
        self.name, self.last_point = name, None
        self._redraw()

    def show(self, sensors: Sequence[Sensor]) -> None:
        """Show the chosen one of the device's cords in the controls."""
        chosen = self.find(sensors)
        if chosen is None:
            self.name = None
        self._list.options = (NONE, *(s.name for s in sensors))
        self._list.value = self.name or NONE
        self._name.value = self.name or ""
        for control in (self._name, self._freedom):
            control.disabled = chosen is None
        if chosen is not None:
            self._freedom.value = next(
                label for label, free in _FREEDOMS.items() if set(free) == set(chosen.free)
            )

    def add_point(self) -> None:
        """Add a control point in the middle of the longest span."""
        self._edit(self._insert_in_longest_span)

    def delete_point(self) -> None:
        """Delete the control point that was dragged last."""
        index, self.last_point = self.last_point, None
        if index is None:
            self._bench.status.show(
                "Drag a point first. The point that was dragged last is deleted.",
                "no-point-dragged",
            )
        else:
            self._edit(lambda cord: delete_point(cord.name, index))

    def smooth(self) -> None:
        """Compute the tangents from the control points."""
        self._edit(lambda cord: smooth(cord.name))

    def add_mirrored(self) -> None:
        """Add a copy that is mirrored at the body's middle."""
        self._edit(self._mirrored)

    def delete(self) -> None:
        """Delete the cord from the device."""
        name = self.name
        if name is None:
            self._show_no_cord()
            return
        self.name = None
        self._bench.apply(remove_cord(name))

    def _rename(self, text: str) -> None:
        name = text.strip()
        if self.name is None or name in ("", self.name):
            return
        before, self.name = self.name, name
        if not self._bench.apply(rename_cord(before, name)):
            self.name = before
            self._redraw()

    def _set_freedom(self, label: str) -> None:
        if self.name is not None:
            self._bench.apply(set_freedoms(self.name, _FREEDOMS[label]))

    def _edit(self, edit: Callable[[Sensor], Edit]) -> None:
        chosen = self.find(self._bench.project.device.sensors)
        if chosen is None:
            self._show_no_cord()
            return
        self._bench.apply(edit(chosen))

    def _show_no_cord(self) -> None:
        self._bench.status.show("Choose a cord first.", "no-cord-chosen")

    def _insert_in_longest_span(self, cord: Sensor) -> Edit:
        spans = np.linalg.norm(np.diff(cord.curve.points, axis=0), axis=1)
        k = int(spans.argmax())
        self.last_point = None
        return insert_point(cord.name, k + 1, cord.curve.sample(2)[2 * k + 1])

    def _mirrored(self, cord: Sensor) -> Edit:
        surface = self._bench.surface
        names = [s.name for s in self._bench.project.device.sensors]
        v = np.zeros((1, 3)) if surface is None else surface.vertices
        middle = (v.min(axis=0) + v.max(axis=0)) / 2
        normal = np.eye(3)[_MIRROR_AXES[self._mirror.value]]
        name = free_name(f"{cord.name}-mirrored", names)
        return mirror_cord(cord.name, name, middle, normal)
