"""The panel of the mode in which one looks inside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...core.curve import Plane
from ...core.device.device import Sensor
from ..workbench.workbench import Workbench
from .section_quantities import Look, LOOKS

_AXES = ("X", "Y", "Z")
_NO_PLANE, _ANGLE = "choose a cord", "the angle below"
_HELP = "The cut follows the handle; click on it for numbers."


class SectionPanel:
    """Its controls, and what they are set to. What is to be done is set by the mode."""

    def __init__(self, bench: Workbench) -> None:
        self._gui, self._sensors = bench.server.gui, tuple[Sensor, ...]()
        self.on_change: Callable[[], None] = _nothing
        self.on_axis: Callable[[int], None] = _nothing
        self.on_plane: Callable[[Plane], None] = _nothing
        self.on_offset: Callable[[float], None] = _nothing
        self._placing = False
        gui = self._gui
        self._said = gui.add_markdown(_HELP)
        self._look = self._chosen(
            gui.add_dropdown(
                "Colours",
                [look.label for look in LOOKS],
                initial_value=LOOKS[1].label,
                hint="What they stand for",
            )
        )
        self._state = self._chosen(
            gui.add_dropdown("State", ("rest",), hint="The body at rest, or as it was simulated")
        )
        self._axis = gui.add_button_group("Plane", _AXES, hint="Square to an axis, in the middle")
        self._axis.on_click(lambda _: self.on_axis(_AXES.index(self._axis.value)))
        self._cord = gui.add_dropdown("Plane of", (_NO_PLANE,), hint="The plane of a cord")
        self._cord.on_update(self._cord_chosen)
        self._offset = gui.add_slider(
            "Offset, mm", -1.0, 1.0, 0.1, 0.0, hint="From the body's middle, along the normal"
        )
        self._offset.on_update(self._slid)
        self._along = self._chosen(
            gui.add_dropdown("Along", (_ANGLE,), hint="The angle, or the cord's local direction")
        )
        self._angle = self._chosen(
            gui.add_slider("Angle, °", 0, 180, 1, 0, hint="From the plane's x, the red arrow")
        )
        self._own = self._chosen(
            gui.add_checkbox("Range of this state", False, hint="Or the same for all states")
        )
        self._bar = gui.add_html("")
        self._point = gui.add_markdown("")
        self._show_needed()

    def built(self, states: Sequence[str], first: int) -> None:
        """The states that there are, rest first, and which is shown at the beginning."""
        before, known = self._state.value, len(self._state.options) > 1
        self._state.options = tuple(states)
        self._state.value = before if known and before in states else states[first]

    def cords(self, sensors: Sequence[Sensor]) -> None:
        """The device's cords, as they are now."""
        self._sensors = tuple(sensors)
        names = [sensor.name for sensor in sensors]
        for choice, first in ((self._cord, _NO_PLANE), (self._along, _ANGLE)):
            before = choice.value
            choice.options = (first, *names)
            choice.value = before if before in names else first

    @property
    def look(self) -> Look:
        return next(look for look in LOOKS if look.label == self._look.value)

    @property
    def state(self) -> int:
        """0 is rest."""
        return list(self._state.options).index(self._state.value)

    @property
    def angle(self) -> float:
        """Radians."""
        return float(np.radians(self._angle.value))

    @property
    def along(self) -> Sensor | None:
        """The cord whose direction it is; None for the angle."""
        return next((s for s in self._sensors if s.name == self._along.value), None)

    @property
    def own_range(self) -> bool:
        return bool(self._own.value)

    def choose(self, look: Look, state: str = "rest") -> None:
        """What is looked at, from a program."""
        self._look.value, self._state.value = look.label, state
        self._show_needed()

    def next_state(self) -> None:
        """Rest after the last."""
        states = list(self._state.options)
        self._state.value = states[(self.state + 1) % len(states)]

    def say(self, told: str) -> None:
        """Markdown, in place of what is said at the beginning."""
        self._said.content = told

    def drawn(self, offset: tuple[float, float, float], bar: str) -> None:
        """A section has been drawn; where its plane is (see `offsets`), and its bar as HTML."""
        at, low, high = offset
        self._said.content, self._bar.content, self._point.content = _HELP, bar, ""
        self._placing = True
        self._offset.min, self._offset.max = round(low, 1), round(high, 1)
        self._offset.value = round(min(max(at, low), high), 1)
        self._placing = False

    def say_point(self, told: str) -> None:
        """Markdown, of a point of the section."""
        self._point.content = told

    def _chosen(self, control: Any) -> Any:
        control.on_update(self._changed)
        return control

    def _changed(self, event: Any) -> None:
        if event.client is None:  # set by the page itself
            return
        self._show_needed()
        self.on_change()

    def _show_needed(self) -> None:
        """Only what the chosen colours depend on."""
        look = self.look
        self._along.visible = look.along
        self._angle.visible = look.along and self.along is None
        self._own.visible = look.of_state

    def _cord_chosen(self, event: Any) -> None:
        if event.client is None:
            return
        cord = next((s for s in self._sensors if s.name == self._cord.value), None)
        if cord is not None:
            self.on_plane(cord.plane)
            self._cord.value = _NO_PLANE  # so that it can be chosen again

    def _slid(self, event: Any) -> None:
        if event.client is not None and not self._placing:
            self.on_offset(float(self._offset.value))


def _nothing(*_: Any) -> None:
    """Until the mode says what is to be done."""
